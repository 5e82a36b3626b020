"""What is known of grippers and cable from late, partial and noisy observations."""

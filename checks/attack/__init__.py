"""What a hostile hour does to cableway, drawn from a seed: wrong files, forged records, hostile loops, interrupts."""

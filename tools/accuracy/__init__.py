"""How accurate the simulator is: experiments, their reference, their pictures. See `tools/simulator_accuracy.py`."""

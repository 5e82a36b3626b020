"""How accurate the simulator is: experiments, their reference, their pictures. See `studies/simulator_accuracy.py`."""

"""How far impact_gym.fidelity can be trusted: its constants, and a table of what each reduction costs and saves."""

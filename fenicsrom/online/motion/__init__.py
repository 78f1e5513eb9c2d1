"""What a time integration returns, its energy balance, and numbers computed from it."""

"""What a small correction at the arm gives an operator who acts late: delays, couplings, operators, assistances."""

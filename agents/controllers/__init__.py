"""Classical control: time-varying LQR tracking, cascaded PD, model predictive control."""

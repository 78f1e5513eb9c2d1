"""One time step: the schemes, the state, Newton's method, and the loop over steps."""

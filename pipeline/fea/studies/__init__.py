"""The paper's studies of the actuator."""

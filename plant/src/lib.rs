//! The physics: transmissions, friction, sensors.

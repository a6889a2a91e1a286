//! The main job on the embedded simulated rig.

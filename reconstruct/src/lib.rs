//! From a posed sequence to Gaussians and rendered panoramas.

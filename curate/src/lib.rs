//! From raw 360-degree video to verified, cut and posed sequences.

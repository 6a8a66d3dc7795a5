//! Scenes, models and devices that several tests use.

pub(crate) use omnilife_engine::render::reference;

pub(crate) mod balls;
pub(crate) mod device;
pub(crate) mod flight;
pub(crate) mod gains;
pub(crate) mod held_camera;
pub(crate) mod moving_ball;
pub(crate) mod novel_views;
pub(crate) mod painted_room;
pub(crate) mod post;
pub(crate) mod random_models;
pub(crate) mod same_gaussians;
pub(crate) mod scenes;
pub(crate) mod trained;

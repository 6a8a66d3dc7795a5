//! `tracks`: what moves through a scene, in its images and in space.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{store::Record, trajectory::ObjectPath};

/// `tracks.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Tracks {
    /// Id of the scene.
    pub scene: String,
    /// Numbers of the frames that were looked at, in order.
    pub frames: Vec<u32>,
    /// Width and height of the images that boxes are in, pixels.
    pub image_size: [u32; 2],
    /// Unit vector of the world that points up.
    pub up: [f64; 3],
    /// Metres in a unit of the world.
    pub metres_per_unit: f64,
    /// How it was made, stage by stage.
    pub stages: Vec<TrackStage>,
    /// Everything that was found in the images.
    pub detections: Vec<Detection>,
    /// What follows from it: one entry per object that moves.
    pub tracks: Vec<Track>,
    /// What was left out, and why, in words.
    pub warnings: Vec<String>,
}

impl Record for Tracks {
    const SCHEMA: &'static str = "omnilife/tracks/1";
}

/// A stage of the making of tracks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackStage {
    /// Its name: detector, distance, association, trajectory.
    pub stage: String,
    /// Which way was taken.
    pub method: String,
    /// On what evidence.
    pub reason: String,
    /// Wall-clock time, seconds.
    pub wall_seconds: f64,
}

/// Something that was found in an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Detection {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Left, top, width and height of its box, pixels.
    pub box_pixels: [f64; 4],
    /// Of the detector, in [0, 1]; 0 where it found nothing and the path of a track fills the gap.
    pub confidence: f64,
    /// What it is, such as `vehicle`.
    pub class: String,
    /// Distance of its middle from the camera along the ray, world units.
    pub distance: Option<f64>,
    /// Where its middle is in the world.
    pub position: Option<[f64; 3]>,
    /// The track that it is of.
    pub track: Option<u32>,
}

/// An object that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Track {
    /// Unique in its file; of detections too.
    pub id: u32,
    /// What it is.
    pub class: String,
    /// Length, width and height of its box, world units.
    pub dimensions: [f64; 3],
    /// Where it is while it is known.
    pub path: ObjectPath,
    /// Detections that it rests on.
    pub detections: u32,
    /// How far it gets from where it is first seen, world units.
    pub displacement: f64,
}

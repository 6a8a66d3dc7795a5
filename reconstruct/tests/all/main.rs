//! Integration tests of scenes, methods and training.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod atlas_planes;
mod camera_response;
mod checkpoints;
mod components;
mod depth;
mod dynamic;
mod evidence;
mod exported_splats;
mod gpu;
mod gpu_atlas;
mod gpu_density;
mod gpu_drift;
mod gpu_dynamic;
mod gpu_failures;
mod gpu_fused;
mod gpu_methods;
mod gpu_sums;
mod gpu_training;
mod interpolation;
mod moved_scene;
mod neural_atlas;
mod no_ops;
mod object_graph;
mod object_paths;
mod pinhole;
mod pose_refinement;
mod projections;
mod renderer;
mod stability;
mod support;
mod swept_points;
mod toy_method;
mod trace_rows;
mod tracked_objects;
mod training;

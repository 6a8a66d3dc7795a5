//! The curation crate from outside.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

#[cfg(unix)]
mod annotation;
mod attach;
mod attrition;
mod audit;
mod bad_input;
mod boundaries;
mod caption_endpoint;
mod deeplab;
mod deepsort;
mod dense;
mod depth_prior;
mod exchange;
mod footage;
mod foreign_files;
mod hostile_video;
mod ledger;
mod motion;
mod near_duplicates;
mod odd_videos;
mod origins;
mod overview;
mod pipeline;
mod poses;
mod projections;
mod publication;
mod published_places;
mod registries;
mod shots;
mod slicing;
mod sphere_layouts;
mod sphere_turns;
mod structure_from_motion;
mod support;
mod tracks;
mod transnetv2;

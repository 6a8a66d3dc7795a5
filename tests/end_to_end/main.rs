//! Tests of the binary from outside: its output, its files on disk, and its failures.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

#[cfg(unix)]
mod adapters;
mod assets;
mod atlas;
#[cfg(unix)]
mod attach;
mod bad_input;
#[cfg(unix)]
mod benchmark;
#[cfg(unix)]
mod chance;
#[cfg(target_os = "linux")]
mod containers;
#[cfg(unix)]
mod curation;
#[cfg(unix)]
mod defects;
mod dependency_direction;
#[cfg(unix)]
mod failed_runs;
#[cfg(unix)]
mod faults;
#[cfg(unix)]
mod foreign_files;
mod full_disk;
mod gaussians_in_time;
mod geometry;
mod help;
mod interruption;
#[cfg(unix)]
mod killed;
mod layers;
#[cfg(unix)]
mod ledger;
mod main_job;
#[cfg(unix)]
mod many_videos;
mod masks;
#[cfg(unix)]
mod media;
#[cfg(unix)]
mod outcomes;
mod output;
mod plans;
#[cfg(target_os = "linux")]
mod pose_scores;
mod power_cut;
mod prerequisites;
mod registry;
mod rendering;
#[cfg(unix)]
mod roads;
mod sample_poses;
mod shards;
mod splatters;
mod stages;
mod stills;
mod submissions;
mod support;
#[cfg(unix)]
mod sweeps;
#[cfg(unix)]
mod trial;
mod two_at_once;
mod walk;
#[cfg(unix)]
mod writing_commands;

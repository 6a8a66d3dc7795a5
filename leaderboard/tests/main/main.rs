//! From results to tables and a site.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod aids;
mod figure;
mod leaderboard;
mod objects;
mod outcomes;
mod ownership;
mod published;
mod questions;
mod refusals;
mod repeats;
mod site;
mod support;
mod tables;

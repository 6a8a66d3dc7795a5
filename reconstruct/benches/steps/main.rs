//! Cost of training steps on random scenes, stage by stage.
//!
//! ```text
//! cargo bench --bench steps -- profile [GAUSSIANS] [WIDTH] [projected|ray] [--export FOLDER] [--json]
//! cargo bench --bench steps -- scaling FOLDER
//! RAYON_NUM_THREADS=1 cargo bench --bench steps -- limits [GAUSSIANS] [WIDTH]
//! cargo bench --bench steps -- gpu static|dynamic|deformable GAUSSIANS WIDTH STEPS
//! ```
//!
//! * [`profile`]: one size on the CPU; `--export` writes the scene for `scripts/compare`.
//! * [`scaling`]: cost against size on the CPU.
//! * [`limits`]: rasterization against the limits of the CPU.
//! * [`gpu`]: one size on the GPU.

mod gpu;
mod iteration;
mod limits;
mod profile;
mod scaling;
mod scene;

use std::{error::Error, str::FromStr};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    match words.as_slice() {
        // As `cargo bench` runs every bench, without arguments.
        [] => {
            println!("steps: give profile, scaling, limits or gpu");
            Ok(())
        }
        ["profile", words @ ..] => profile::run(words),
        ["scaling", folder] => scaling::run(folder.as_ref()),
        ["limits", words @ ..] => limits::run(words),
        ["gpu", kind, gaussians, width, steps] => {
            gpu::run(kind, gaussians.parse()?, width.parse()?, steps.parse()?)
        }
        _ => Err("steps: see the head of benches/steps/main.rs".into()),
    }
}

/// Returns argument number `at`, or `default` where there are fewer.
fn number<T: FromStr>(words: &[&str], at: usize, default: T) -> Result<T, T::Err> {
    words.get(at).map_or(Ok(default), |word| word.parse())
}

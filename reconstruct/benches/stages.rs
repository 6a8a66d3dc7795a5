//! CPU time per stage of a training iteration, over image sizes and numbers of Gaussians.
//!
//! `cargo bench --bench stages`, or `cargo bench --bench stages -- 512x256/50000` for one size.

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use omnilife_engine::render::settings::RenderSettings;
use omnilife_reconstruct::step_cost::cpu::Iteration;

const WIDTHS: [u32; 2] = [512, 1024];
const COUNTS: [usize; 2] = [50_000, 200_000];

fn stages(criterion: &mut Criterion) {
    for (width, count) in WIDTHS.into_iter().flat_map(|w| COUNTS.map(|c| (w, c))) {
        let mut group = criterion.benchmark_group(format!("{width}x{}/{count}", width / 2));
        group.sample_size(10);
        let mut iteration = Iteration::new(count, width, RenderSettings::new(0.01));
        let mut names = vec!["iteration"];
        iteration.run(|name, _| names.push(name));
        for stage in names {
            group.bench_function(stage, |bencher| {
                bencher.iter_custom(|repetitions| {
                    let mut total = 0.0;
                    for _ in 0..repetitions {
                        iteration.run(|name, seconds| {
                            if stage == name || stage == "iteration" {
                                total += seconds;
                            }
                        });
                    }
                    Duration::from_secs_f64(total)
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, stages);
criterion_main!(benches);

//! Costs of steps as Markdown.

use std::fmt::Write;

use omnilife_engine::step::BackendChoice;

use super::{SceneKind, StepCost};

/// One table for the stages of all sizes, one for what a step costs beside them.
pub fn table(costs: &[StepCost]) -> String {
    let Some(first) = costs.first() else {
        return String::new();
    };
    let mut text = format!("On {}.\n", first.device);
    let is_device = first.request.backend == BackendChoice::Gpu;
    if let Some(copied) = first.copied_per_second {
        let _ = writeln!(
            text,
            "It copies {:.1} GB/s, read and written.",
            copied * 1e-9
        );
    }
    if is_device {
        text += &match first.subgroup_size {
            Some(size) => format!("Sums over pixels in subgroups of {size} threads at least.\n"),
            None => "Sums over pixels in the memory of workgroups.\n".to_owned(),
        };
    }
    text += "\n";
    text += &stage_table(costs, is_device);
    text += "\n";
    text += &step_table(costs, is_device);
    text
}

fn size_of(cost: &StepCost) -> String {
    let request = &cost.request;
    let kind = match request.kind {
        SceneKind::Static => String::new(),
        kind => format!(", {}", kind.name()),
    };
    format!(
        "{}k, {}x{}{kind}",
        request.gaussians / 1_000,
        request.width,
        request.width / 2
    )
}

/// Milliseconds of each stage; on a device with the kernels started, the bytes of their buffers if each passed
/// once for each kernel, and the share of a copy's bandwidth that this is.
fn stage_table(costs: &[StepCost], is_device: bool) -> String {
    let mut names: Vec<&str> = Vec::new();
    for (stage, _) in costs.iter().flat_map(|cost| &cost.stages) {
        if !names.contains(stage) {
            names.push(stage);
        }
    }
    let sizes: Vec<String> = costs.iter().map(size_of).collect();
    let mut text = if is_device {
        let heads = sizes
            .iter()
            .map(|size| format!(" {size}: ms | kernels | MB | share of bandwidth |"));
        format!("| Stage |{}\n", heads.collect::<String>())
    } else {
        format!("| Stage, CPU ms | {} |\n", sizes.join(" | "))
    };
    let columns = if is_device { 4 } else { 1 } * costs.len();
    text += &format!("|---|{}\n", "---:|".repeat(columns));
    for name in names {
        let _ = write!(text, "| {name} |");
        for cost in costs {
            let stage = cost.stages.iter().find(|(stage, _)| *stage == name);
            let stage = stage.map(|(_, stage)| *stage).unwrap_or_default();
            let ms = stage
                .seconds
                .map_or("-".to_owned(), |seconds| format!("{:.3}", seconds * 1e3));
            let _ = write!(text, " {ms} |");
            if is_device {
                let share = stage
                    .seconds
                    .filter(|&seconds| seconds > 0.0)
                    .zip(cost.copied_per_second)
                    .map_or("-".to_owned(), |(seconds, copied)| {
                        format!("{:.0} %", 100.0 * stage.bytes as f64 / seconds / copied)
                    });
                let megabytes = stage.bytes as f64 * 1e-6;
                let _ = write!(text, " {} | {megabytes:.1} | {share} |", stage.dispatches);
            }
        }
        text += "\n";
    }
    text
}

fn step_table(costs: &[StepCost], is_device: bool) -> String {
    let milliseconds = |seconds: f64| format!("{:.2}", seconds * 1e3);
    let mut rows: Vec<(&str, Vec<String>)> = Vec::new();
    let mut add = |name, value: &dyn Fn(&StepCost) -> String| {
        rows.push((name, costs.iter().map(value).collect()));
    };
    add("wall ms of a step", &|cost| milliseconds(cost.wall_seconds));
    add("steps a second", &|cost| {
        format!("{:.1}", 1.0 / cost.wall_seconds.max(1e-9))
    });
    add("CPU ms of a step", &|cost| {
        cost.cpu_seconds.map_or("-".to_owned(), milliseconds)
    });
    if is_device {
        add("kernels of a step", &|cost| {
            let dispatches = cost.stages.iter().map(|(_, stage)| stage.dispatches);
            dispatches.sum::<u64>().to_string()
        });
        add("bytes read back in 1,000 iterations", &|cost| {
            cost.bytes_read.to_string()
        });
        let densification = |cost: &StepCost, number: usize| {
            let density = cost.density.unwrap_or_default()[number];
            format!(
                "{} ({} until decided, {} after; {} bytes read, {} made)",
                milliseconds(density.seconds()),
                milliseconds(density.decision_seconds),
                milliseconds(density.device_seconds),
                density.bytes_read,
                density.made
            )
        };
        add("ms of a densification that needs more room", &|cost| {
            densification(cost, 0)
        });
        add("ms of one within its room", &|cost| densification(cost, 1));
    }
    let sizes: Vec<String> = costs.iter().map(size_of).collect();
    let mut text = format!("| Step | {} |\n", sizes.join(" | "));
    text += &format!("|---|{}\n", "---:|".repeat(costs.len()));
    for (name, values) in rows {
        let _ = writeln!(text, "| {name} | {} |", values.join(" | "));
    }
    text
}

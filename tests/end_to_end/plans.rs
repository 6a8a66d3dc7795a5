//! Plans of training (`omnilife reconstruct plan`): costs in work, which repeat exactly.

use assert_cmd::cargo::cargo_bin_cmd;

use crate::support::{SEQUENCE, omnilife, small_run};

/// Returns the command line of a plan of the sample.
fn arguments(method: &str, further: &[&str]) -> Vec<String> {
    let scene = small_run().out.join(SEQUENCE);
    let split = scene.join("per-scene/split.json");
    let mut arguments = vec!["reconstruct", "plan", scene.to_str().unwrap(), "--split"];
    arguments.extend([split.to_str().unwrap(), "--method", method]);
    arguments.extend(["--iterations", "30", "--set", "max-gaussians=300"]);
    arguments.extend(further);
    arguments.into_iter().map(str::to_owned).collect()
}

/// Returns the printed plan of the sample.
fn plan(method: &str, further: &[&str]) -> String {
    omnilife(arguments(method, further)).succeeded().stdout
}

#[test]
fn a_plan_that_is_the_full_one_is_not_compared_with_it() {
    for method in ["odgs", "omni4dgs-plus"] {
        let text = plan(method, &["--plan", "full"]);
        let line = text.lines().last().unwrap_or_default();
        assert!(line.contains("plans are the same"), "{text}");
        for word in ["smaller", "fewer", "pixels"] {
            assert!(!line.contains(word), "{text}");
        }
    }
}

#[test]
fn the_cost_of_a_plan_repeats_exactly() {
    let text = plan("omni4dgs-plus", &[]);
    let line = text.lines().last().unwrap_or_default();
    for words in ["tables ", "trained values ", "pixels a step "] {
        assert!(line.contains(words), "{text}");
    }
    assert_eq!(plan("omni4dgs-plus", &[]), text);
}

#[test]
fn a_plan_for_a_gpu_has_its_memory() {
    if omnilife_engine::device::adapters::adapters().is_empty() {
        omnilife_schemas::testing::skip("no GPU, not even a software one");
        return;
    }
    let text = plan("odgs", &["--backend", "gpu"]);
    let line = text.lines().find(|line| line.starts_with("On "));
    let line = line.unwrap_or_else(|| panic!("{text}"));
    let is_complete = line.contains(": at most 300 Gaussians in ")
        && line.contains(" MB, the largest buffer (")
        && line.ends_with("the adapter holds them");
    assert!(is_complete, "{line}");
    let on_cpu = plan("odgs", &[]);
    assert!(
        !on_cpu.lines().any(|line| line.starts_with("On ")),
        "{on_cpu}"
    );
}

/// Drivers that look for a display in vain print errors.
#[test]
fn a_machine_without_a_display_is_not_an_error() {
    if omnilife_engine::device::adapters::adapters().is_empty() {
        omnilife_schemas::testing::skip("no GPU, not even a software one");
        return;
    }
    let mut command = cargo_bin_cmd!("omnilife");
    for name in ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "DISPLAY"] {
        command.env_remove(name);
    }
    command.args(arguments("odgs", &["--backend", "gpu", "--quiet"]));
    let output = command.output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
}

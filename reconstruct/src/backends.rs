//! Tables of methods and backends in Markdown, and the requirements of a backend.

use std::fmt::Write;

use omnilife_engine::{
    device::{GpuError, adapters::adapters},
    kernels::{KERNELS, KernelTwins, PARAMETERIZATIONS},
    step::BackendChoice,
};

use crate::registry::METHODS;
use omnilife_training::{components::camera_response, error::ReconstructError, method::Method};

/// Components without GPU kernels, of methods that have them otherwise.
const ON_CPU_ALONE: [&str; 1] = [camera_response::ID];

/// Checks that the machine has the device of a backend.
///
/// # Errors
/// [`GpuError::NoAdapter`] when a GPU is requested and no adapter is found, not even a software one.
pub fn check(backend: BackendChoice) -> Result<(), ReconstructError> {
    if backend == BackendChoice::Gpu && adapters().is_empty() {
        return Err(GpuError::NoAdapter.into());
    }
    Ok(())
}

/// Returns tables of methods, components, parameterizations and kernels with `Present` or `Missing` on each
/// backend.
pub fn tables() -> String {
    let mut text = "| Method | CPU | GPU |\n|---|---|---|\n".to_owned();
    for method in METHODS.iter().filter(|method| method.is_trained()) {
        row(&mut text, method.id, runs_on_gpu(method));
    }
    text += "\n| Component | CPU | GPU |\n|---|---|---|\n";
    for component in components() {
        let has = |method: &Method| components_of(method).any(|name| name == component);
        let on_gpu = !ON_CPU_ALONE.contains(&component)
            && METHODS
                .iter()
                .any(|method| runs_on_gpu(method) && has(method));
        row(&mut text, component, on_gpu);
    }
    text += "\n| Parameterization | CPU | GPU |\n|---|---|---|\n";
    kernel_rows(&mut text, PARAMETERIZATIONS);
    text += "\n| Kernels | CPU | GPU |\n|---|---|---|\n";
    kernel_rows(&mut text, KERNELS);
    text
}

fn row(text: &mut String, name: &str, on_gpu: bool) {
    let presence = if on_gpu { "Present" } else { "Missing" };
    let _ = writeln!(text, "| {name} | Present | {presence} |");
}

fn kernel_rows(text: &mut String, all: &[KernelTwins]) {
    for twins in all {
        row(text, twins.name, twins.gpu.is_some());
    }
}

fn runs_on_gpu(method: &Method) -> bool {
    method.backends.contains(&BackendChoice::Gpu)
}

fn components_of(method: &Method) -> impl Iterator<Item = &'static str> {
    let all = method.components.iter().chain(method.optional_components);
    all.copied()
}

/// Returns the components of all methods, each once, in the order in which methods name them.
fn components() -> Vec<&'static str> {
    let mut all = Vec::new();
    for name in METHODS.iter().flat_map(components_of) {
        if !all.contains(&name) {
            all.push(name);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use super::*;

    #[test]
    fn the_page_has_what_the_command_prints() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference/backends.md");
        let page = fs::read_to_string(&file).expect("the page is there");
        let (before, rest) = page.split_once("| Method | CPU").expect("has the tables");
        let (_, after) = rest.split_once("\n\nDensity").expect("has text below");
        let expected = format!("{before}{}\n\nDensity{after}", tables().trim_end());
        if std::env::var_os("UPDATE_BACKENDS_TABLE").is_some() {
            fs::write(&file, &expected).expect("can be written");
        }
        let page = fs::read_to_string(&file).expect("the page is there");
        assert!(
            page == expected,
            "docs/reference/backends.md is not what `omnilife reconstruct backends` prints: \
             UPDATE_BACKENDS_TABLE=1 cargo test -p omnilife-reconstruct the_page_has_what_the_command_prints"
        );
    }
}

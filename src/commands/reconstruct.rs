//! `omnilife reconstruct`.

use omnilife_curate::slicing::Projection;
use omnilife_reconstruct::{
    backends,
    jobs::{
        atlas,
        edit::{self, EditRunRequest},
        edit_objects::{self, EditRequest},
        export::{self, serve::Server},
        plan_cost,
        reconstruct::{self, ReconstructRequest},
        render,
    },
    methods::{METHODS, Method},
    process,
    request::BackendChoice,
};
use omnilife_schemas::{camera::Camera, progress::Progress};

use super::{note_far_frames, video};
use crate::{
    cli::{AssetArguments, ReconstructCommand, RenderArguments},
    exit, termination,
};

pub(crate) fn execute(command: &ReconstructCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        ReconstructCommand::Train {
            scene,
            split,
            out,
            method,
            iterations,
            memory,
        } => {
            if let Some(bytes) = memory {
                process::limit_memory(*bytes);
            }
            termination::guard_training()?;
            let record = reconstruct::reconstruct(
                &ReconstructRequest {
                    scene: scene.clone(),
                    split: split.clone(),
                    method: method.method.clone(),
                    settings: method.request(*iterations)?,
                    backend: method.backend.into(),
                    checkpoint_every: method.checkpoint_every,
                    trace_views: method.trace_views,
                    out: out.clone(),
                },
                progress,
            )?;
            exit::print(&format!(
                "{} on {}: {} iterations, {} primitives, trained in {:.1} s; {}\n",
                record.method,
                record.scene,
                record.iterations,
                record.primitives,
                record.training_seconds,
                out.join(reconstruct::RUN_FILE).display()
            ))
        }
        ReconstructCommand::Plan {
            scene,
            split,
            method,
            iterations,
        } => {
            let request = method.request(*iterations)?;
            let plan = plan_cost::plan(scene, split, &method.method, &request)?;
            note_far_frames(scene, progress)?;
            exit::print(&plan.text())
        }
        ReconstructCommand::Render(arguments) => render(arguments, progress),
        ReconstructCommand::Export(arguments) => export(arguments, progress),
        ReconstructCommand::Serve { asset, port } => {
            let server = Server::listen(asset, *port)?;
            exit::print(&format!(
                "http://{}/ (ends with Ctrl-C)\n",
                server.address()?
            ))?;
            server.run();
            Ok(())
        }
        ReconstructCommand::Atlas { run, out } => {
            let files = atlas::export(run, out, progress)?;
            exit::print(&format!("{} files in {}\n", files.len(), out.display()))
        }
        ReconstructCommand::Edit {
            run,
            script: Some(script),
            out,
            ..
        } => {
            let request = EditRunRequest {
                run: run.clone(),
                script: script.clone(),
                out: out.clone(),
            };
            let done = edit::edit(&request, progress)?;
            let lines = done.iter().map(|line| format!("{line}\n"));
            exit::print(&lines.collect::<String>())
        }
        ReconstructCommand::Edit {
            run,
            script: None,
            objects,
            out,
        } => {
            let request = EditRequest {
                run: run.clone(),
                edits: objects.edits()?,
                out: out.clone(),
            };
            let left = edit_objects::edit(&request, progress)?;
            exit::print(&format!("{}: {} objects\n", out.display(), left.len()))
        }
        ReconstructCommand::Methods => {
            exit::print(&METHODS.iter().map(description).collect::<String>())
        }
        ReconstructCommand::Backends => exit::print(&backends::tables()),
    }
}

/// A method for the list, one fact per line.
fn description(method: &Method) -> String {
    let mut text = format!(
        "{}\n  {}\n  {}\n  {}\n",
        method.id, method.title, method.source, method.description
    );
    let backends = method.backends.iter().map(|backend| match backend {
        BackendChoice::Cpu => "cpu",
        BackendChoice::Gpu => "gpu",
    });
    text += &format!("  Backends: {}\n", backends.collect::<Vec<_>>().join(", "));
    for (label, components) in [
        ("Components", method.components),
        ("On request", method.optional_components),
    ] {
        if !components.is_empty() {
            text += &format!("  {label}: {}\n", components.join(", "));
        }
    }
    if !method.options.is_empty() {
        text += "  Options (--set NAME=VALUE):\n";
    }
    for option in method.options {
        text += &format!(
            "    {}: {}; {} [default: {}]\n",
            option.id,
            option.doc,
            option.values.text(),
            option.default
        );
    }
    text
}

fn export(arguments: &AssetArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let exported = export::export(&arguments.request(), progress)?;
    for note in &exported.notes {
        progress.note(note);
    }
    let (asset, out) = (&exported.asset, &arguments.out);
    let mut text = String::new();
    for level in &asset.levels {
        text += &format!(
            "{}: {} Gaussians, {:.1} MB, {}\n",
            level.name,
            level.splats,
            level.bytes as f64 / 1e6,
            out.join(&level.file).display()
        );
    }
    if let Some(page) = &asset.page {
        text += &format!(
            "{:.1} MB, {}\n",
            page.bytes as f64 / 1e6,
            out.join(&page.file).display()
        );
    }
    exit::print(&text)
}

fn render(arguments: &RenderArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    if let Some(file) = &arguments.video {
        // Found out before the rendering, not after it.
        video::check(file)?;
    }
    let rendered = render::render_poses(&arguments.request(), progress)?;
    let mut text = format!(
        "{} views in {}\n",
        rendered.files.len(),
        arguments.out.display()
    );
    if rendered.unposed > 0 {
        text += &format!(
            "{} frames have no usable pose and are left out\n",
            rendered.unposed
        );
    }
    if let Some(speed) = rendered.largest_speed {
        text += &format!(
            "grey is still; 0 and 1 are {speed:.3} world units per second along the axes x, y, z\n"
        );
    }
    if let Some(file) = &arguments.video {
        let projection = match rendered.camera {
            Camera::Erp(_) => Projection::Equirectangular,
            Camera::Pinhole(_) => Projection::Flat,
        };
        let (images, times) = (&rendered.files, &rendered.times_seconds);
        let rate = video::encode(images, times, projection, file)?;
        text += &format!("{} at {rate:.3} frames per second\n", file.display());
    }
    exit::print(&text)
}

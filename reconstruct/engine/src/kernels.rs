//! Catalogue of this crate's computations on each backend.

/// A computation with its file on the CPU and its twin on a GPU, if any; paths are relative to `src`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KernelTwins {
    /// Description.
    pub name: &'static str,
    /// The file on the CPU.
    pub cpu: &'static str,
    /// The file on a GPU.
    pub gpu: Option<&'static str>,
}

const fn twins(name: &'static str, cpu: &'static str, gpu: Option<&'static str>) -> KernelTwins {
    KernelTwins { name, cpu, gpu }
}

/// Parameterizations, in the order of their publication.
pub const PARAMETERIZATIONS: &[KernelTwins] = &[
    twins(
        "static",
        "gaussians/static_gaussians.rs",
        Some("gaussians/static_gaussians/static_gaussians.wgsl"),
    ),
    twins(
        "temporal",
        "gaussians/temporal.rs",
        Some("gaussians/temporal/temporal.wgsl"),
    ),
    twins(
        "deformable",
        "gaussians/deformable.rs",
        Some("gaussians/deformable/deformable.wgsl"),
    ),
    twins(
        "tracked",
        "gaussians/tracked.rs",
        Some("gaussians/tracked/tracked.wgsl"),
    ),
];

/// All other kernels, in the order of a training step.
pub const KERNELS: &[KernelTwins] = &[
    twins(
        "projection and its gradient",
        "render/project/cpu.rs",
        Some("render/project/project.wgsl"),
    ),
    twins("sort", "render/sort/cpu.rs", Some("render/sort/sort.wgsl")),
    twins(
        "tile lists",
        "render/bin/cpu.rs",
        Some("render/bin/bin.wgsl"),
    ),
    twins(
        "rasterization and its gradient",
        "render/raster/cpu.rs",
        Some("render/raster/raster.wgsl"),
    ),
    twins(
        "renderer with the published quirks",
        "render/published/mod.rs",
        None,
    ),
    twins(
        "photometric loss",
        "losses/photometric/cpu.rs",
        Some("losses/photometric/loss.wgsl"),
    ),
    twins(
        "losses on velocity, lifespan and opacity maps",
        "losses/maps.rs",
        Some("losses/maps/maps.wgsl"),
    ),
    twins(
        "dynamic Gaussians alone",
        "gaussians/subset.rs",
        Some("gaussians/temporal/dynamic.wgsl"),
    ),
    twins(
        "motion regularization",
        "losses/motion.rs",
        Some("losses/motion/motion.wgsl"),
    ),
    twins(
        "loss on a fused surface",
        "losses/scaffold/mod.rs",
        Some("losses/scaffold/scaffold.wgsl"),
    ),
    twins(
        "gradient by the pose",
        "render/project/by_camera.rs",
        Some("render/project/by_camera/by_camera.wgsl"),
    ),
    twins(
        "dropout",
        "gaussians/dropout.rs",
        Some("gaussians/dropout/dropout.wgsl"),
    ),
    twins(
        "Adam",
        "parameters/adam/cpu.rs",
        Some("parameters/adam/adam.wgsl"),
    ),
    twins(
        "multilayer perceptron",
        "fields/mlp/passes.rs",
        Some("fields/mlp/passes.wgsl"),
    ),
    twins(
        "products of matrices",
        "fields/mlp/product.rs",
        Some("fields/mlp/product.wgsl"),
    ),
    twins(
        "hash grid",
        "fields/hash_grid/passes.rs",
        Some("fields/hash_grid/hash_grid.wgsl"),
    ),
    twins(
        "textures and appearance of surfaces",
        "surfaces/texture.rs",
        Some("surfaces/surfaces.wgsl"),
    ),
    twins(
        "layers of rays",
        "surfaces/compose.rs",
        Some("surfaces/compose.wgsl"),
    ),
    twins(
        "intersections of rays with surfaces",
        "surfaces/plane.rs",
        None,
    ),
    twins(
        "statistics for density control",
        "step/cpu.rs",
        Some("step/step.wgsl"),
    ),
    twins(
        "density control",
        "density/mod.rs",
        Some("density/density.wgsl"),
    ),
    twins(
        "opacity reset",
        "density/mod.rs",
        Some("step/opacity_reset.wgsl"),
    ),
    twins(
        "limit of sizes",
        "step/size_limit.rs",
        Some("step/size_limit.wgsl"),
    ),
];

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, fs, path::Path};

    use super::*;
    use crate::{
        clock::Clock,
        gaussians::{
            deformable::{Deformable, DeformationModel, settings::DeformationSettings},
            parameterization::Parameterization,
            static_gaussians::StaticGaussians,
            temporal::{TimeModel, VelocityModel},
            temporal_gaussians::TemporalGaussians,
            tracked::TrackedGaussians,
        },
    };

    #[test]
    fn files_are_where_they_are_said_to_be() {
        let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        for twins in PARAMETERIZATIONS.iter().chain(KERNELS) {
            for file in [Some(twins.cpu), twins.gpu].into_iter().flatten() {
                assert!(src.join(file).is_file(), "{}: {file}", twins.name);
            }
        }
    }

    /// Kernel files that belong to a listed one, or that several share.
    const HELPERS: [&str; 7] = [
        "density/moving.wgsl",
        "device/scan.wgsl",
        "parameters/rows.wgsl",
        "render/raster/raster_vjp.wgsl",
        "render/raster/raster_vjp_splats.wgsl",
        "render/raster/raster_vjp_subgroups.wgsl",
        "step/fused_adam.wgsl",
    ];

    /// Finds files with entry points below a folder, as paths relative to `src`.
    fn kernel_files(folder: &Path, src: &Path, found: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                kernel_files(&path, src, found);
            } else if path
                .extension()
                .is_some_and(|extension| extension == "wgsl")
                && fs::read_to_string(&path)
                    .expect("a file")
                    .contains("@compute")
            {
                let path = path.strip_prefix(src).expect("below it");
                found.insert(path.to_string_lossy().replace('\\', "/"));
            }
        }
    }

    #[test]
    fn every_file_of_kernels_is_listed_and_every_listed_one_has_some() {
        let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let mut found = BTreeSet::new();
        kernel_files(&src, &src, &mut found);
        let listed = PARAMETERIZATIONS.iter().chain(KERNELS);
        let listed = listed.filter_map(|twins| twins.gpu).chain(HELPERS);
        assert_eq!(found, listed.map(str::to_owned).collect());
    }

    #[test]
    fn parameterizations_with_kernels_on_a_gpu_are_those_of_the_list() {
        let clock = Clock::new(0.0, 1.0, 1.0);
        let temporal = TemporalGaussians {
            clock,
            time: TimeModel {
                cycle_frames: 1.0,
                lifespans: None,
                velocity: VelocityModel::Free,
                least_marginal: 0.0,
            },
            down: [0.0, 1.0, 0.0],
            dynamic_below_staticness: 1.0,
        };
        let model = DeformationModel::published(1.0);
        let settings = DeformationSettings {
            clock,
            model,
            warm_up_iterations: 0,
            time_noise: None,
        };
        let weights = vec![0.0; model.network().weight_count()];
        let made: [Box<dyn Parameterization>; 4] = [
            Box::new(StaticGaussians),
            Box::new(temporal),
            Box::new(Deformable::new(settings, weights)),
            Box::new(TrackedGaussians::new(Vec::new(), true)),
        ];
        let on_gpu = PARAMETERIZATIONS.iter().filter(|twins| twins.gpu.is_some());
        let listed: Vec<&str> = on_gpu.map(|twins| twins.name).collect();
        assert_eq!(listed, made.each_ref().map(|one| one.id()));
        assert!(made.iter().all(|one| one.device_twin().is_some()));
    }
}

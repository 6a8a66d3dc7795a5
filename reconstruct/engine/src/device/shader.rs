//! Assembly of WGSL modules, and structures shared by Rust and WGSL.

/// WGSL helpers of all kernels: `WORKGROUP`, `workgroup_number`, `is_finite` and `is_nan`.
pub const COMMON_WGSL: &str = include_str!("common.wgsl");
/// WGSL structure `Status` of training steps, in the buffer with which a kernel learns of halted steps.
pub const STATUS_WGSL: &str = include_str!("status.wgsl");

/// Source of a WGSL module: constants, then the files.
#[derive(Debug, Clone)]
pub struct Shader {
    /// The kernel's file, for messages.
    pub file: &'static str,
    /// Its constants.
    pub constants: String,
    /// Texts of the files that the kernel's file needs, followed by that file.
    pub parts: &'static [&'static str],
}

impl Shader {
    /// Returns the source of the whole module.
    pub(crate) fn text(&self) -> String {
        let mut text = self.constants.clone();
        for part in self.parts {
            text += part;
        }
        text
    }
}

/// Structure declared in Rust and in WGSL; a test compares the layouts.
#[cfg_attr(not(test), expect(dead_code, reason = "the layout is read by a test"))]
pub(crate) trait WgslStruct: bytemuck::Pod {
    /// Names of the members with their offsets in bytes.
    const MEMBERS: &'static [(&'static str, usize)];
}

/// Declares structures with [`WgslStruct`]. Members named `pad...` are padding.
macro_rules! wgsl_struct {
    ($($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(#[$field_meta:meta])* $field:ident: $kind:ty,)*
    })*) => {$(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        $vis struct $name {
            $($(#[$field_meta])* pub(crate) $field: $kind,)*
        }

        impl $crate::device::shader::WgslStruct for $name {
            const MEMBERS: &'static [(&'static str, usize)] =
                &[$((stringify!($field), std::mem::offset_of!($name, $field)),)*];
        }
    )*};
}
pub(crate) use wgsl_struct;

#[cfg(test)]
mod tests {
    use naga::{
        AddressSpace, Module, TypeInner,
        front::wgsl,
        proc::Layouter,
        valid::{Capabilities, ModuleInfo, ValidationFlags, Validator},
    };

    use super::*;
    use crate::{
        density,
        device::{PixelSums, scan},
        fields::{hash_grid, mlp},
        gaussians::{activated_buffers, deformable, dropout, static_gaussians, temporal, tracked},
        losses::{maps, motion, photometric, scaffold},
        parameters::{adam, rows},
        render::{bin, buffers, project, raster, sort},
        step::gpu::{fused_adam, kernels, opacity_reset, size_limit},
        surfaces,
    };

    fn shaders() -> Vec<Shader> {
        let shapes = [0, 3].map(|features| buffers::RenderShape {
            gaussians: 1,
            sh_degree: 3,
            features,
            width: 16,
            height: 8,
            entries: 1,
        });
        let mut shaders = vec![
            scan::shader(),
            sort::gpu::shader(),
            photometric::gpu::shader(),
            adam::gpu::shader(),
            rows::shader(),
            opacity_reset::shader(),
            density::gpu::shader(),
            static_gaussians::gpu::shader(),
            dropout::gpu::shader(),
            temporal::gpu::shader(),
            temporal::gpu::dynamic_shader(),
            tracked::gpu::shader(),
            maps::gpu::shader(),
            motion::gpu::shader(),
            scaffold::gpu::shader(),
            deformable::gpu::shader(),
            mlp::gpu::shader(),
            mlp::product_gpu::shader(),
            hash_grid::gpu::shader(),
            surfaces::gpu::shader(0.1),
            surfaces::gpu::compose_shader(),
        ];
        for shape in &shapes {
            shaders.extend([
                project::gpu::shader(shape),
                bin::gpu::shader(shape),
                raster::gpu::shader(shape, PixelSums::Workgroups),
                raster::gpu::shader(shape, PixelSums::Splats),
                kernels::shader(shape),
                fused_adam::shader(shape),
                size_limit::shader(shape),
                project::by_camera::gpu::shader(shape),
            ]);
        }
        shaders
    }

    /// Returns shaders that use subgroups, by the smallest subgroup, and their form with a thread per splat.
    fn raster_shaders() -> impl Iterator<Item = Shader> {
        let shape = |features| buffers::RenderShape {
            gaussians: 1,
            sh_degree: 3,
            features,
            width: 16,
            height: 8,
            entries: 1,
        };
        let sizes = [4, 8, 16, 32, 64].into_iter();
        let forms = sizes.map(PixelSums::Subgroups).chain([PixelSums::Splats]);
        forms.flat_map(move |sums| [0, 4].map(|f| raster::gpu::shader(&shape(f), sums)))
    }

    fn parse(shader: &Shader) -> Module {
        let text = shader.text();
        wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{}: {}", shader.file, error.emit_to_string(&text)))
    }

    #[test]
    fn every_module_is_valid_without_optional_features() {
        for shader in shaders() {
            validate(&shader, Capabilities::empty());
        }
    }

    fn validate(shader: &Shader, capabilities: Capabilities) -> ModuleInfo {
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        match validator.validate(&parse(shader)) {
            Ok(info) => info,
            Err(error) => panic!("{}: {}", shader.file, error.emit_to_string(&shader.text())),
        }
    }

    #[test]
    fn forms_of_sums_over_pixels_are_valid_and_fit_a_workgroup() {
        for shader in raster_shaders() {
            let info = validate(&shader, Capabilities::SUBGROUP);
            let module = parse(&shader);
            let mut layouter = Layouter::default();
            layouter.update(module.to_ctx()).expect("sizes");
            for (number, entry_point) in module.entry_points.iter().enumerate() {
                let uses = info.get_entry_point(number);
                let used = module.global_variables.iter().filter(|(variable, global)| {
                    global.space == AddressSpace::WorkGroup && !uses[*variable].is_empty()
                });
                let bytes: u32 = used.map(|(_, global)| layouter[global.ty].size).sum();
                assert!(bytes <= 16 * 1024, "{}: {bytes} bytes", entry_point.name);
            }
        }
    }

    /// Compares every WGSL structure named `name` with Rust's `T`; returns the number found.
    fn compare<T: WgslStruct>(modules: &[(&'static str, Module)], name: &str) -> usize {
        let mut found = 0;
        for (file, module) in modules {
            for (_, kind) in module.types.iter() {
                let TypeInner::Struct { members, span } = &kind.inner else {
                    continue;
                };
                if kind.name.as_deref() != Some(name) {
                    continue;
                }
                found += 1;
                let of_wgsl: Vec<(String, usize)> = members
                    .iter()
                    .map(|member| {
                        (
                            member.name.clone().unwrap_or_default(),
                            member.offset as usize,
                        )
                    })
                    .collect();
                let of_rust: Vec<(String, usize)> = T::MEMBERS
                    .iter()
                    .filter(|(member, _)| !member.starts_with("pad"))
                    .map(|&(member, offset)| (member.to_owned(), offset))
                    .collect();
                assert_eq!(of_wgsl, of_rust, "members of {name} in {file}");
                assert_eq!(*span as usize, size_of::<T>(), "size of {name} in {file}");
            }
        }
        found
    }

    #[test]
    fn structures_have_the_same_layout_on_both_sides() {
        let modules: Vec<(&'static str, Module)> = shaders()
            .iter()
            .map(|shader| (shader.file, parse(shader)))
            .collect();
        let found = [
            compare::<buffers::ViewUniform>(&modules, "View"),
            compare::<activated_buffers::DeviceGaussian>(&modules, "Gaussian"),
            compare::<buffers::DeviceSplat>(&modules, "Splat"),
            compare::<buffers::DeviceStatus>(&modules, "Status"),
            compare::<scan::ScanLevel>(&modules, "ScanLevel"),
            compare::<sort::gpu::SortPass>(&modules, "SortPass"),
            compare::<photometric::gpu::LossSettings>(&modules, "LossSettings"),
            compare::<adam::gpu::AdamStep>(&modules, "AdamStep"),
            compare::<rows::RowMove>(&modules, "RowMove"),
            compare::<opacity_reset::OpacityReset>(&modules, "OpacityReset"),
            compare::<density::gpu::DensityStep>(&modules, "DensityStep"),
            compare::<density::gpu::DensityView>(&modules, "DensityView"),
            compare::<density::gpu::Child>(&modules, "Child"),
            compare::<static_gaussians::gpu::StaticArrays>(&modules, "StaticArrays"),
            compare::<dropout::gpu::DeviceDropout>(&modules, "StepDropout"),
            compare::<kernels::StepView>(&modules, "StepView"),
            compare::<temporal::gpu::TemporalView>(&modules, "TemporalView"),
            compare::<tracked::gpu::TrackedRows>(&modules, "TrackedRows"),
            compare::<tracked::gpu::ObjectPlace>(&modules, "ObjectPlace"),
            compare::<maps::gpu::MapLosses>(&modules, "MapLosses"),
            compare::<motion::gpu::MotionWeight>(&modules, "MotionWeight"),
            compare::<scaffold::gpu::ScaffoldLoss>(&modules, "ScaffoldLoss"),
            compare::<project::by_camera::gpu::DevicePoseGradient>(&modules, "PoseGradient"),
            compare::<deformable::gpu::Canonical>(&modules, "Canonical"),
            compare::<mlp::gpu::SharedInputs>(&modules, "SharedInputs"),
            compare::<mlp::blocks_gpu::BlockRows>(&modules, "BlockRows"),
            compare::<mlp::gpu::RowSums>(&modules, "RowSums"),
            compare::<mlp::gpu::PartSums>(&modules, "PartSums"),
            compare::<mlp::product_gpu::Product>(&modules, "Product"),
            compare::<hash_grid::gpu::GridLevel>(&modules, "GridLevel"),
            compare::<hash_grid::gpu::GridRows>(&modules, "GridRows"),
            compare::<hash_grid::gpu::LevelGroup>(&modules, "LevelGroup"),
            compare::<surfaces::gpu::surface::SurfaceUniform>(&modules, "Surface"),
            compare::<surfaces::gpu::surface::SurfaceSample>(&modules, "Sample"),
            compare::<surfaces::gpu::surface::MomentKnots>(&modules, "MomentKnots"),
            compare::<surfaces::gpu::RayBatch>(&modules, "RayBatch"),
        ];
        assert!(found.iter().all(|&count| count > 0), "{found:?}");
    }
}

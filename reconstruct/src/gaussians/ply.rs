//! Export of Gaussians as the PLY that 3DGS writes and its viewers read.
//!
//! Properties as in 3DGS `scene/gaussian_model.py` `save_ply`: x y z, nx ny nz (zero), `f_dc_*`,
//! opacity (logit), `scale_*` (logarithm), `rot_*` (w, x, y, z). Coordinates are the scene's own:
//! the normalization is undone.

use std::{io::Write, path::Path};

use glam::DVec3;
use omnilife_schemas::{
    Similarity,
    store::{self, StoreError},
};

use super::{
    GaussianTable,
    static_gaussians::{LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT},
};

const PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
    "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];

/// Writes static Gaussians, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    table: &GaussianTable,
    normalization: &Similarity,
) -> Result<(), StoreError> {
    let array = |index: usize| table.arrays[index].values.as_slice();
    let positions = array(POSITIONS).as_chunks::<3>().0;
    let sh = array(SH_CONSTANT).as_chunks::<3>().0;
    let log_scales = array(LOG_SCALES).as_chunks::<3>().0;
    let quaternions = array(QUATERNIONS).as_chunks::<4>().0;
    let logits = array(OPACITY_LOGITS);
    let log_unit = normalization.scale.ln() as f32;
    store::write_with(path, |writer| {
        write!(
            writer,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
            table.len()
        )?;
        for property in PROPERTIES {
            writeln!(writer, "property float {property}")?;
        }
        writeln!(writer, "end_header")?;
        for index in 0..table.len() {
            let world = normalization
                .restore(DVec3::from_array(positions[index].map(f64::from)))
                .as_vec3();
            let rows = [
                world.to_array().as_slice(),
                &[0.0; 3],
                &sh[index],
                &logits[index..=index],
                &log_scales[index].map(|log_scale| log_scale - log_unit),
                &quaternions[index],
            ]
            .concat();
            for value in rows {
                writer.write_all(&value.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::points::PointCloud;

    use super::*;
    use crate::gaussians::static_gaussians::{self, InitialGaussians};

    #[test]
    fn exports_world_coordinates() -> Result<(), Box<dyn std::error::Error>> {
        let normalization = Similarity {
            offset: [10.0, 20.0, 30.0],
            scale: 0.5,
        };
        let table = static_gaussians::table(&InitialGaussians {
            positions: vec![[1.0, 2.0, 3.0]],
            scales: vec![0.25],
            colours: vec![[0.5; 3]],
            opacities: vec![0.5],
        });
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("gaussians.ply");
        write(&path, &table, &normalization)?;
        assert_eq!(PointCloud::read_ply(&path)?.positions, [[12.0, 24.0, 36.0]]);
        let bytes = std::fs::read(&path)?;
        let values = bytes[bytes.len() - PROPERTIES.len() * 4..]
            .as_chunks::<4>()
            .0;
        let scale = f32::from_le_bytes(values[10]).exp();
        assert!(
            (scale - 0.5).abs() < 1e-6,
            "a quarter unit is half a world unit: {scale}"
        );
        Ok(())
    }
}

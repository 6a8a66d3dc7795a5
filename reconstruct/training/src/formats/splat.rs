//! The `.splat` of web viewers: 32 bytes per Gaussian, without a header (antimatter15/splat `convert.py`).
//!
//! ```text
//! f32 x 3  position          f32 x 3  standard deviations
//! u8 x 4   red, green, blue, opacity     u8 x 4   quaternion (w, x, y, z), 128 (q + 1)
//! ```
//!
//! Little-endian; rows by volume times opacity, the largest first, so that a viewer shows the most covering
//! Gaussians while it loads. Bytes are rounded here, but cut off in `convert.py`: the rotation of a quaternion is
//! off by half as much.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use glam::{DQuat, DVec3};
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians, SH_C0,
        static_gaussians::{InitialGaussians, table},
    },
    parameters::ParameterTable,
};
use omnilife_schemas::{
    Similarity,
    records::InvalidGaussians,
    store::{self, StoreError},
};
use rayon::prelude::*;

use super::validity::{self, FileGaussian};

/// Bytes of a Gaussian.
pub const ROW_BYTES: usize = 32;
/// Maximum number of rows of a file: those in a texture of 8192 x 2048 with two texels each.
pub const MOST_ROWS: u64 = 8192 * 2048 / 2;

/// One Gaussian in the form of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatRow {
    /// Centre.
    pub position: [f32; 3],
    /// Standard deviations, positive.
    pub scale: [f32; 3],
    /// Red, green, blue and opacity.
    pub rgba: [u8; 4],
    /// Unit quaternion (w, x, y, z).
    pub rotation: [f32; 4],
}

impl SplatRow {
    /// Returns a Gaussian as a renderer sees it, with its constant colour.
    #[expect(clippy::indexing_slicing, reason = "the Gaussian is one of them")]
    pub fn of(gaussians: &ActivatedGaussians, index: usize) -> Self {
        let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let [red, green, blue] =
            gaussians.sh_constant[index].map(|coefficient| byte(0.5 + SH_C0 * coefficient));
        Self {
            position: gaussians.positions[index],
            scale: gaussians.scales[index],
            rgba: [red, green, blue, byte(gaussians.opacities[index])],
            rotation: gaussians.rotations[index],
        }
    }

    /// Returns the valid form of the row, or `None` if it is left out; `place` is its centre in the units of its
    /// storage. Counts invalid values.
    pub fn valid(mut self, place: [f64; 3], invalid: &mut InvalidGaussians) -> Option<Self> {
        let opacity = f64::from(self.rgba[3]) / 255.0;
        let given = FileGaussian {
            position: place,
            log_scales: self.scale.map(|scale| f64::from(scale).ln()),
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
            quaternion: self.rotation.map(f64::from),
        };
        let valid = validity::valid(&given, invalid)?;
        // Valid values stay unchanged, to the bit.
        if valid.log_scales != given.log_scales {
            self.scale = valid.log_scales.map(|log| log.exp() as f32);
        }
        if valid.quaternion != given.quaternion {
            self.rotation = valid.quaternion.map(|part| part as f32);
        }
        Some(self)
    }

    /// Returns the sort key of rows: volume times opacity.
    fn weight(&self) -> f32 {
        self.scale.iter().product::<f32>() * f32::from(self.rgba[3])
    }

    #[expect(clippy::indexing_slicing, reason = "places within a row")]
    fn bytes(&self) -> [u8; ROW_BYTES] {
        let mut bytes = [0; ROW_BYTES];
        let (floats, rest) = bytes.split_at_mut(24);
        let values = self.position.iter().chain(&self.scale);
        for (to, value) in floats.as_chunks_mut::<4>().0.iter_mut().zip(values) {
            *to = value.to_le_bytes();
        }
        rest[..4].copy_from_slice(&self.rgba);
        for (to, value) in rest[4..].iter_mut().zip(self.rotation) {
            *to = (128.0 + 128.0 * value).round().clamp(0.0, 255.0) as u8;
        }
        bytes
    }
}

/// Returns the bytes of rows, the largest first.
#[expect(
    clippy::indexing_slicing,
    reason = "the order is one of the rows that are there"
)]
pub(super) fn ordered(rows: &[SplatRow]) -> Vec<[u8; ROW_BYTES]> {
    let mut order: Vec<(f32, u32)> = rows
        .par_iter()
        .enumerate()
        .map(|(index, row)| (row.weight(), index as u32))
        .collect();
    // Among equals the earlier one comes first: one order on every machine.
    order.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // Rows are fetched from all over the memory: the file's form is shorter.
    let unordered: Vec<[u8; ROW_BYTES]> = rows.par_iter().map(SplatRow::bytes).collect();
    order
        .par_iter()
        .map(|(_, index)| unordered[*index as usize])
        .collect()
}

/// Writes rows atomically, the largest first; returns the SHA-256 of the file.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, rows: &[SplatRow]) -> Result<String, StoreError> {
    let ordered = ordered(rows);
    let bytes = ordered.as_flattened();
    let (written, sha256) = rayon::join(
        || store::write_bytes(path, bytes),
        || store::sha256_bytes(bytes),
    );
    written.map(|()| sha256)
}

/// Map from the world's coordinates to a file's: `y = scale R (x - offset)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// World point that is the file's origin.
    pub offset: DVec3,
    /// Units of the file per unit of the world.
    pub scale: f64,
    /// World to file.
    pub rotation: DQuat,
}

impl Placement {
    /// The map of a file in world coordinates.
    pub const WORLD: Self = Self {
        offset: DVec3::ZERO,
        scale: 1.0,
        rotation: DQuat::IDENTITY,
    };

    pub(super) fn to_world(self, place: DVec3) -> DVec3 {
        self.rotation.inverse() * place / self.scale + self.offset
    }
}

/// Reads a file into normalized coordinates of the world; invalid values are repaired or left out, and counted in
/// `invalid`.
///
/// # Errors
/// When the file is missing, or does not hold a whole number of rows. When a row has a position that is not a
/// number or a size that is negative or not finite; the error names the row.
pub fn read(
    path: &Path,
    placement: &Placement,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, StoreError> {
    let bytes = std::fs::read(path).map_err(|source| StoreError::read(path, source))?;
    from_bytes(path, &bytes, placement, normalization, invalid)
}

/// Reads a file's bytes like [`read`]; `path` names the file.
///
/// # Errors
/// Those of [`read`].
pub fn from_bytes(
    path: &Path,
    bytes: &[u8],
    placement: &Placement,
    normalization: &Similarity,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, StoreError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let (rows, rest) = bytes.as_chunks::<ROW_BYTES>();
    if !rest.is_empty() || rows.is_empty() {
        let reason = format!(
            "must have whole rows of {ROW_BYTES} bytes, got {} bytes: it is cut off, or not a .splat",
            bytes.len()
        );
        return Err(malformed(reason));
    }
    let mut initial = InitialGaussians::default();
    let to_world = placement.rotation.inverse();
    let unit = normalization.scale / placement.scale;
    for (number, row) in rows.iter().enumerate() {
        let row = parsed(row).map_err(|reason| malformed(format!("row {number} {reason}")))?;
        let place = DVec3::from_array(row.position.map(f64::from));
        let place = normalization.normalize(placement.to_world(place));
        let Some(row) = row.valid(place.to_array(), invalid) else {
            continue;
        };
        let [w, x, y, z] = row.rotation.map(f64::from);
        let turned = to_world * DQuat::from_xyzw(x, y, z, w);
        initial.positions.push(place.as_vec3().to_array());
        initial.scales.push(
            row.scale
                .map(|scale| ((f64::from(scale) * unit) as f32).max(f32::MIN_POSITIVE)),
        );
        initial
            .rotations
            .push([turned.w, turned.x, turned.y, turned.z].map(|q| q as f32));
        let [red, green, blue, opacity] = row.rgba.map(|byte| f32::from(byte) / 255.0);
        initial.colours.push([red, green, blue]);
        initial.opacities.push(opacity);
    }
    Ok(table(&initial, 0))
}

/// Returns a row of a file, with its quaternion normalized if it has a length.
#[expect(clippy::indexing_slicing, reason = "places within a row")]
fn parsed(bytes: &[u8; ROW_BYTES]) -> Result<SplatRow, String> {
    let mut floats = [0.0; 6];
    for (to, from) in floats.iter_mut().zip(bytes.as_chunks::<4>().0) {
        *to = f32::from_le_bytes(*from);
    }
    let [x, y, z, a, b, c] = floats;
    if [x, y, z].iter().any(|place| place.is_nan()) {
        return Err("has a place that is not a number".to_owned());
    }
    // From 0 on: other programs round small ones to 0.
    if ![a, b, c]
        .iter()
        .all(|size| (0.0..f32::INFINITY).contains(size))
    {
        return Err("has a size that is negative or not finite".to_owned());
    }
    let rgba = [bytes[24], bytes[25], bytes[26], bytes[27]];
    let rotation = [28, 29, 30, 31].map(|at| (f32::from(bytes[at]) - 128.0) / 128.0);
    let length = rotation.iter().map(|q| q * q).sum::<f32>().sqrt();
    let length = if length > 0.0 { length } else { 1.0 };
    Ok(SplatRow {
        position: [x, y, z],
        scale: [a, b, c],
        rgba,
        rotation: rotation.map(|q| q / length),
    })
}

#[cfg(test)]
mod tests {
    use omnilife_engine::gaussians::static_gaussians::{
        LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT, activate, sigmoid,
    };
    use proptest::prelude::*;

    use super::*;

    const STAY: Similarity = Similarity::new([0.0; 3], 1.0);

    fn row(position: [f32; 3], scale: [f32; 3], opacity: u8) -> SplatRow {
        SplatRow {
            position,
            scale,
            rgba: [10, 20, 30, opacity],
            rotation: [0.5, -0.5, 0.5, 0.5],
        }
    }

    #[test]
    fn rows_are_those_of_the_layout_and_the_largest_comes_first()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.splat");
        let small = row([1.0, 2.0, 3.0], [0.1; 3], 255);
        let large = row([4.0, 5.0, 6.0], [0.2; 3], 200);
        let faint = row([7.0, 8.0, 9.0], [0.2; 3], 3);
        write(&path, &[small, faint, large])?;
        let bytes = std::fs::read(&path)?;
        assert_eq!(bytes.len(), 3 * ROW_BYTES);
        let first = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[at + byte]));
        assert_eq!([first(0), first(32), first(64)], [4.0, 1.0, 7.0]);
        assert_eq!(bytes[24..32], [10, 20, 30, 200, 192, 64, 192, 192]);
        Ok(())
    }

    /// Compares with `scripts/golden/splat.py`.
    #[test]
    fn the_bytes_are_those_of_the_layout() -> Result<(), Box<dyn std::error::Error>> {
        let expected = [
            "000000000000000000000000b25abc3eb25abc3e55950a3e878e95fa8df6599a",
            "000020c10000003e0000f040b25abc3eb25abc3e55950a3e00ff8045c040c040",
            "0000c03f000010c00000404086ed4b3d8160f73cffc9dc3ba36ec7e1ff808080",
        ];
        let mut table = ParameterTable::new(3);
        let positions = [1.5, -2.25, 3.0, -10.0, 0.125, 7.5, 0.0, 0.0, 0.0];
        let log_scales = [-3.0, -3.5, -5.0, -1.0, -1.0, -2.0, -1.0, -1.0, -2.0];
        let quaternions = [
            2.0, 0.0, 0.0, 0.0, 0.5, -0.5, 0.5, -0.5, 0.1, 0.9, -0.3, 0.2,
        ];
        let colours = [0.5, -0.25, 1.0, -2.5, 2.5, 0.0, 0.1, 0.2, 0.3];
        table.add("positions", 3, positions.into(), 0.0);
        table.add("log_scales", 3, log_scales.into(), 0.0);
        table.add("quaternions", 4, quaternions.into(), 0.0);
        table.add("opacity_logits", 1, vec![2.0, -1.0, 4.0], 0.0);
        table.add("sh_constant", 3, colours.into(), 0.0);
        let mut gaussians = ActivatedGaussians::default();
        activate(&table, &mut gaussians);
        let rows: Vec<SplatRow> = (0..3)
            .map(|index| SplatRow::of(&gaussians, index))
            .collect();
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.splat");
        write(&path, &rows)?;
        let bytes = std::fs::read(&path)?;
        for (row, expected) in bytes.as_chunks::<ROW_BYTES>().0.iter().zip(expected) {
            let found: String = row.iter().map(|byte| format!("{byte:02x}")).collect();
            // exp() of another library may differ in the last bit: those words by their value.
            let word = |text: &str, at: usize| {
                u32::from_str_radix(&text[8 * at..8 * at + 8], 16).map(u32::swap_bytes)
            };
            for at in 3..6 {
                let [a, b] = [word(&found, at)?, word(expected, at)?];
                assert!(a.abs_diff(b) <= 1, "{found} {expected}");
            }
            assert_eq!(
                (&found[..24], &found[48..]),
                (&expected[..24], &expected[48..])
            );
        }
        Ok(())
    }

    #[test]
    fn what_is_no_splat_is_refused_with_its_row() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.splat");
        let good = row([1.0, 2.0, 3.0], [0.1; 3], 255).bytes();
        let changed = |at: usize, with: [u8; 4]| {
            let mut bytes = [good, good].concat();
            bytes[ROW_BYTES + at..ROW_BYTES + at + 4].copy_from_slice(&with);
            bytes
        };
        for (bytes, expected) in [
            (good[..31].to_vec(), "must have whole rows"),
            (Vec::new(), "must have whole rows"),
            (
                changed(4, f32::NAN.to_le_bytes()),
                "row 1 has a place that is not a number",
            ),
            (changed(16, (-0.1_f32).to_le_bytes()), "row 1 has a size"),
            (changed(12, f32::INFINITY.to_le_bytes()), "row 1 has a size"),
            (changed(20, f32::NAN.to_le_bytes()), "row 1 has a size"),
        ] {
            std::fs::write(&path, bytes)?;
            let mut invalid = InvalidGaussians::default();
            let message = read(&path, &Placement::WORLD, &STAY, &mut invalid);
            let message = message.map(drop).err();
            let message = message.map(|error| error.to_string()).unwrap_or_default();
            assert!(
                message.contains(expected) && message.contains("a.splat"),
                "{message}"
            );
        }
        Ok(())
    }

    #[test]
    fn rows_that_are_not_valid_are_repaired_or_left_out_and_counted()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.splat");
        let good = row([1.0, 2.0, 3.0], [0.1; 3], 255);
        let mut rows = [good; 6].map(|row| row.bytes());
        rows[1][28..].fill(128);
        rows[2][16..20].fill(0);
        rows[3][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
        rows[4][27] = 0;
        rows[5].fill(0);
        std::fs::write(&path, rows.as_flattened())?;
        let mut invalid = InvalidGaussians::default();
        let table = read(&path, &Placement::WORLD, &STAY, &mut invalid)?;
        let expected = InvalidGaussians {
            transparent: 2,
            out_of_reach: 1,
            unrotated: 1,
            flat: 1,
            ..InvalidGaussians::default()
        };
        assert_eq!((table.len(), invalid), (3, expected));
        assert_eq!(table.row(QUATERNIONS, 1), [1.0, 0.0, 0.0, 0.0]);
        let sizes = table.row(LOG_SCALES, 2);
        assert!(sizes[1].is_finite() && sizes[1] < -80.0, "{sizes:?}");
        assert!((sizes[0] - 0.1_f32.ln()).abs() < 1e-5, "{sizes:?}");
        Ok(())
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            values in prop::collection::vec((prop::array::uniform3(-1e4_f32..1e4),
                prop::array::uniform3(1e-4_f32..10.0), prop::array::uniform4(0_u8..=255),
                prop::array::uniform4(-1.0_f32..1.0)), 1..20)
        ) {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("a.splat");
            let rows: Vec<SplatRow> = values
                .into_iter()
                .map(|(position, scale, mut rgba, q)| {
                    // A Gaussian of opacity 0 is left out.
                    rgba[3] = rgba[3].max(1);
                    let length = q.iter().map(|q| q * q).sum::<f32>().sqrt().max(1e-3);
                    SplatRow { position, scale, rgba, rotation: q.map(|q| q / length) }
                })
                .filter(|row| row.rotation.iter().map(|q| q * q).sum::<f32>() > 0.9)
                .collect();
            prop_assume!(!rows.is_empty());
            write(&path, &rows).expect("written");
            let mut invalid = InvalidGaussians::default();
            let table = read(&path, &Placement::WORLD, &STAY, &mut invalid).expect("read");
            prop_assert_eq!(invalid, InvalidGaussians::default());
            prop_assert_eq!(table.len(), rows.len());
            let mut sorted = rows;
            sorted.sort_by(|a, b| b.weight().total_cmp(&a.weight()));
            for (index, row) in sorted.iter().enumerate() {
                prop_assert_eq!(table.row(POSITIONS, index), &row.position[..]);
                for (found, scale) in table.row(LOG_SCALES, index).iter().zip(row.scale) {
                    prop_assert!((found - scale.ln()).abs() < 1e-5);
                }
                for (found, byte) in table.row(SH_CONSTANT, index).iter().zip(row.rgba) {
                    prop_assert!((0.5 + SH_C0 * found - f32::from(byte) / 255.0).abs() < 1e-5);
                }
                let opacity = sigmoid(table.row(OPACITY_LOGITS, index)[0]);
                prop_assert!((opacity - f32::from(row.rgba[3]) / 255.0).abs() < 1e-5);
                let dot: f32 = table.row(QUATERNIONS, index).iter().zip(row.rotation)
                    .map(|(a, b)| a * b).sum();
                // A byte of a quaternion is half a degree.
                prop_assert!(dot.abs().min(1.0).acos().to_degrees() < 1.0, "{}", dot);
            }
        }
    }
}

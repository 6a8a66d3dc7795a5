//! Unchanged Gaussians for formats beyond `.splat`: in the frame of files, with their harmonics.

use glam::DQuat;
use omnilife_engine::gaussians::{ActivatedGaussians, sh_rest_count};
use omnilife_schemas::records::{AssetChanges, InvalidGaussians};
use omnilife_training::formats::axes::HarmonicTurn;
use rayon::prelude::*;

use super::viewer_limits::{Drawable, FileFrame};

/// Moves Gaussians into a frame. Those whose opacity rounds to 0 in 8 bits are left out; `invalid` counts
/// Gaussians that a file cannot hold.
pub(super) fn whole(
    gaussians: &ActivatedGaussians,
    frame: &FileFrame,
    invalid: &mut InvalidGaussians,
) -> Drawable {
    let mut changes = AssetChanges::default();
    let rest = sh_rest_count(gaussians.sh_degree);
    let mut kept = ActivatedGaussians {
        sh_degree: gaussians.sh_degree,
        ..ActivatedGaussians::default()
    };
    for index in 0..gaussians.len() {
        let row = frame.row(gaussians, index);
        if row.rgba[3] == 0 {
            changes.transparent += 1;
            continue;
        }
        let Some(row) = row.valid(row.position.map(f64::from), invalid) else {
            continue;
        };
        kept.positions.push(row.position);
        kept.scales.push(row.scale);
        kept.rotations.push(row.rotation);
        kept.opacities.push(gaussians.opacities[index]);
        kept.sh_constant.push(gaussians.sh_constant[index]);
        let coefficients = &gaussians.sh_rest[rest * index..rest * (index + 1)];
        kept.sh_rest.extend_from_slice(coefficients);
    }
    if rest > 0 && frame.turn() != DQuat::IDENTITY {
        let turn = HarmonicTurn::new(frame.turn());
        let rows = kept.sh_rest.par_chunks_exact_mut(rest);
        rows.for_each(|row| turn.apply(row));
    }
    Drawable {
        rows: Vec::new(),
        whole: Some(kept),
        moments: None,
        placement: frame.placement(1.0),
        changes,
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn nothing_changes_but_the_frame_and_harmonics_turn_with_it() {
        let mut gaussians = ActivatedGaussians::default();
        gaussians.reshape(3, 1, 0);
        gaussians.scales.fill([0.5, 1e-4, 0.25]);
        gaussians.rotations.fill([1.0, 0.0, 0.0, 0.0]);
        gaussians.opacities = vec![0.9, 1e-4, 0.5];
        gaussians.positions[0] = [0.0, 0.0, 1e5];
        // Brighter towards z, which is up.
        gaussians.sh_rest[1] = [0.5; 3];
        let frame = FileFrame::new(DVec3::Z, DVec3::ONE, 2.0);
        let drawable = whole(&gaussians, &frame, &mut InvalidGaussians::default());
        assert_eq!((drawable.len(), drawable.changes.transparent), (2, 1));
        assert_eq!(
            (drawable.placement.scale, drawable.changes.thickened),
            (1.0, 0)
        );
        let kept = drawable.whole.unwrap_or_default();
        let [x, y, z] = kept.positions[0];
        assert!(
            x.abs() < 0.1 && (y + 2e5).abs() < 0.1 && z.abs() < 0.1,
            "{x} {y} {z}"
        );
        assert_eq!(kept.scales[0], [1.0, 2e-4, 0.5]);
        assert_eq!(kept.opacities, [0.9, 0.5]);
        // Up is -y, whose harmonic has the sign of it.
        let expected = [[0.5; 3], [0.0; 3], [0.0; 3]];
        for (found, expected) in kept
            .sh_rest
            .as_flattened()
            .iter()
            .zip(expected.as_flattened())
        {
            assert!((found - expected).abs() < 1e-6, "{:?}", kept.sh_rest);
        }
        assert_eq!(kept.sh_rest.len(), 6);
    }
}

//! Every format with Gaussians of all kinds, written and read, in the file's and the world's coordinates.

use omnilife_engine::gaussians::{sh_rest_count, subset};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;

/// Returns Gaussians whose values are within the range of all formats, poles of quaternions among them.
pub(in crate::formats) fn varied(len: usize, degree: usize) -> ActivatedGaussians {
    let mut random = Pcg64Mcg::seed_from_u64(17 + len as u64);
    let mut gaussians = ActivatedGaussians::default();
    gaussians.reshape(len, degree, 0);
    for index in 0..len {
        let mut signs = |size: f32| random.random_range(-size..size);
        gaussians.positions[index] = [signs(30.0), signs(5.0), signs(80.0)];
        gaussians.scales[index] = [0, 1, 2].map(|_| (-3.0 + signs(4.0)).exp());
        let mut quaternion = [0, 1, 2, 3].map(|_| signs(1.0));
        if let Some(pole) = quaternion.get_mut(index) {
            *pole = if signs(1.0) < 0.0 { -1e4 } else { 1e4 };
        }
        let length = quaternion
            .iter()
            .map(|part| part * part)
            .sum::<f32>()
            .sqrt();
        gaussians.rotations[index] = quaternion.map(|part| part / length);
        gaussians.opacities[index] = 0.5 + signs(0.45);
        gaussians.sh_constant[index] = [0, 1, 2].map(|_| signs(1.7));
    }
    for coefficient in &mut gaussians.sh_rest {
        *coefficient = [0, 1, 2].map(|_| random.random_range(-0.9_f32..0.9));
    }
    gaussians
}

pub(in crate::formats) fn activated(
    name: &str,
    bytes: &[u8],
) -> Result<ActivatedGaussians, String> {
    let mut invalid = InvalidGaussians::default();
    let path = Path::new(name);
    let table = from_bytes(path, bytes, &Placement::WORLD, &UNCHANGED, &mut invalid)
        .map_err(|error| error.to_string())?;
    assert_eq!(invalid, InvalidGaussians::default());
    let mut gaussians = ActivatedGaussians::default();
    static_gaussians::activate(&table, &mut gaussians);
    Ok(gaussians)
}

/// Largest differences between two lists of Gaussians.
#[derive(Debug, Clone, Copy)]
pub(in crate::formats) struct Apart {
    pub(in crate::formats) place: f32,
    pub(in crate::formats) log_size: f32,
    pub(in crate::formats) degrees: f32,
    pub(in crate::formats) opacity: f32,
    pub(in crate::formats) constant: f32,
    pub(in crate::formats) linear: f32,
    pub(in crate::formats) rest: f32,
}

pub(in crate::formats) fn apart(a: &ActivatedGaussians, b: &ActivatedGaussians) -> Apart {
    fn most(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!(a.len(), b.len());
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }
    assert_eq!((a.len(), a.sh_degree), (b.len(), b.sh_degree));
    let logs = |of: &ActivatedGaussians| -> Vec<f32> {
        of.scales
            .as_flattened()
            .iter()
            .map(|scale| scale.ln())
            .collect()
    };
    let count = sh_rest_count(a.sh_degree).max(1);
    // Coefficients of degree 1, and those of the others.
    let harmonics = |of: &ActivatedGaussians, is_linear: bool| -> Vec<f32> {
        let all = of.sh_rest.iter().enumerate();
        let chosen = all.filter(|(index, _)| (index % count < 3) == is_linear);
        chosen.flat_map(|(_, rgb)| *rgb).collect()
    };
    let degrees = |a: &[f32; 4], b: &[f32; 4]| {
        // By the chord: the arc cosine of nearly 1 is inaccurate.
        let along: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let squares = a
            .iter()
            .zip(b)
            .map(|(a, b)| (a - along.signum() * b).powi(2));
        4.0 * (squares.sum::<f32>().sqrt() / 2.0)
            .min(1.0)
            .asin()
            .to_degrees()
    };
    let turns = a.rotations.iter().zip(&b.rotations).map(|(a, b)| {
        let [w, x, y, z] = *b;
        // A half rotation about an axis of its own changes no Gaussian.
        let alike = [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]];
        alike
            .iter()
            .map(|b| degrees(a, b))
            .fold(f32::INFINITY, f32::min)
    });
    Apart {
        place: most(a.positions.as_flattened(), b.positions.as_flattened()),
        log_size: most(&logs(a), &logs(b)),
        degrees: turns.fold(0.0, f32::max),
        opacity: most(&a.opacities, &b.opacities),
        constant: most(a.sh_constant.as_flattened(), b.sh_constant.as_flattened()),
        linear: most(&harmonics(a, true), &harmonics(b, true)),
        rest: most(&harmonics(a, false), &harmonics(b, false)),
    }
}

/// Asserts that differences are within the rounding of all formats.
pub(in crate::formats) fn assert_near(what: &str, a: &ActivatedGaussians, b: &ActivatedGaussians) {
    let apart = apart(a, b);
    // 256 log sizes and 8 bits of a rotation are the coarsest of SOG.
    let (log_size, degrees) = if what.ends_with("sog") {
        (0.06, 1.2)
    } else {
        (0.032, 0.4)
    };
    // A share of 11 bits of 160 units is the coarsest.
    let is_near = apart.place < 0.04
        && apart.log_size < log_size
        && apart.degrees < degrees
        && apart.opacity < 0.0021
        && apart.constant < 0.0135
        && apart.linear < 0.0355
        && apart.rest < 0.067;
    assert!(is_near, "{what} {apart:?}");
}

#[test]
fn formats_have_names_and_endings_of_their_own() {
    for (number, format) in SPLAT_FORMATS.iter().enumerate() {
        let is_other =
            |other: &SplatFormat| other.name != format.name && other.ending != format.ending;
        assert!(SPLAT_FORMATS[..number].iter().all(is_other));
        assert!(by_name(format.name).is_ok_and(|found| found.ending == format.ending));
    }
    assert!(by_name("ksplat").is_err());
}

#[test]
fn what_is_written_is_read_in_every_format_and_degree() {
    for format in SPLAT_FORMATS
        .iter()
        .filter(|format| !format.is_for_old_viewers)
    {
        for degree in 0..=3 {
            let written = varied(300, degree);
            let bytes = (format.write)(&written).expect("written");
            let read = activated(&format!("A{}", format.ending), &bytes).expect("read");
            // Some are ordered along a curve, others as they are given.
            let read = match format.name {
                "compressed-ply" | "sog" => in_order(&written, &read),
                _ => read,
            };
            assert_near(format.name, &written, &read);
            // A second time nothing is rounded away.
            let again = (format.write)(&read).expect("written");
            let change = again.len().abs_diff(bytes.len());
            assert!(change < 64 + bytes.len() / 50, "{}", format.name);
        }
    }
}

/// Returns the Gaussians of one list in the order of another that holds the same.
fn in_order(of: &ActivatedGaussians, gaussians: &ActivatedGaussians) -> ActivatedGaussians {
    let distance =
        |a: [f32; 3], b: [f32; 3]| -> f32 { a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum() };
    let nearest = |place: &[f32; 3]| {
        let others = 0..gaussians.len();
        let of_place = |index: &usize| distance(*place, gaussians.positions[*index]);
        others.min_by(|a, b| of_place(a).total_cmp(&of_place(b)))
    };
    let order: Vec<usize> = of.positions.iter().filter_map(nearest).collect();
    let mut ordered = ActivatedGaussians::default();
    subset::gather(gaussians, &order, &mut ordered);
    ordered
}

/// Reads the files of `scripts/golden/splat_formats.mjs`.
#[test]
fn files_of_a_peer_are_read() {
    let source = activated("source.ply", include_bytes!("peer/source.ply")).expect("read");
    // What another program rounds to few rows of harmonics is read as that program reads it.
    let rounded = activated("a.ply", include_bytes!("peer/read-sog.ply")).expect("read");
    let read = activated("peer.sog", include_bytes!("peer/peer.sog")).expect("read");
    let apart = apart(&rounded, &read);
    let largest = [apart.place, apart.log_size, apart.opacity, apart.constant];
    let largest = largest
        .into_iter()
        .fold(apart.linear.max(apart.rest), f32::max);
    assert!(largest < 1e-4 && apart.degrees < 0.01, "{apart:?}");
    let files: [(&str, &[u8]); 4] = [
        ("version-3.spz", include_bytes!("peer/version-3.spz")),
        ("version-4.spz", include_bytes!("peer/version-4.spz")),
        ("peer.ply", include_bytes!("peer/peer.compressed.ply")),
        ("peer.glb", include_bytes!("peer/peer.glb")),
    ];
    for (name, bytes) in files {
        let read = activated(name, bytes).expect("read");
        assert_near(name, &source, &in_order(&source, &read));
    }
}

#[test]
fn the_page_of_formats_says_what_is_rounded() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/splat-formats.md");
    let page = fs::read_to_string(page).expect("the page");
    for format in SPLAT_FORMATS {
        let row = format!("| `{}` | `{}` |", format.name, format.ending);
        assert!(
            page.contains(&row) && page.contains(format.rounded),
            "{row} {}",
            format.rounded
        );
    }
}

#[test]
fn files_are_read_where_their_record_places_them() {
    let placement = Placement {
        offset: DVec3::new(1e6, -2e5, 40.0),
        scale: 4.0,
        rotation: DQuat::from_xyzw(0.1, 0.7, -0.2, 0.6).normalize(),
    };
    let normalization = Similarity::new([1e6, -2e5, 41.0], 0.5);
    let written = varied(20, 3);
    let back = placement.rotation.inverse();
    let turn = HarmonicTurn::new(back);
    for format in SPLAT_FORMATS
        .iter()
        .filter(|format| !format.is_for_old_viewers)
    {
        let bytes = (format.write)(&written).expect("written");
        let as_it_stands = activated(&format!("a{}", format.ending), &bytes).expect("read");
        let path = format!("a{}", format.ending);
        let mut invalid = InvalidGaussians::default();
        let table = from_bytes(
            Path::new(&path),
            &bytes,
            &placement,
            &normalization,
            &mut invalid,
        );
        let mut found = ActivatedGaussians::default();
        static_gaussians::activate(&table.expect("read"), &mut found);
        let mut expected = as_it_stands.clone();
        for place in &mut expected.positions {
            let world = back * DVec3::from_array(place.map(f64::from)) / 4.0 + placement.offset;
            *place = normalization.normalize(world).as_vec3().to_array();
        }
        for scale in expected.scales.as_flattened_mut() {
            *scale /= 8.0;
        }
        for rotation in &mut expected.rotations {
            let [w, x, y, z] = rotation.map(f64::from);
            let turned = back * DQuat::from_xyzw(x, y, z, w);
            *rotation = [turned.w, turned.x, turned.y, turned.z].map(|part| part as f32);
        }
        for row in expected.sh_rest.chunks_exact_mut(15) {
            turn.apply(row);
        }
        let apart = apart(&expected, &found);
        assert!(
            apart.place < 1e-4 && apart.log_size < 1e-4 && apart.degrees < 0.1,
            "{apart:?}"
        );
        assert!(apart.linear < 1e-4 && apart.rest < 1e-4, "{apart:?}");
    }
}

#[test]
fn cut_off_files_are_refused_in_one_line() {
    for format in SPLAT_FORMATS {
        let bytes = (format.write)(&varied(9, 1)).expect("written");
        let name = format!("a{}", format.ending);
        for length in [0, 1, 11, bytes.len() / 2, bytes.len() - 1] {
            let message = activated(&name, &bytes[..length])
                .map(drop)
                .expect_err("refused");
            assert!(
                message.starts_with(&name) && !message.contains('\n'),
                "{message}"
            );
        }
    }
}

#[test]
fn files_under_other_names_are_told_by_their_beginning() {
    let gaussians = varied(5, 0);
    for format in SPLAT_FORMATS {
        let bytes = (format.write)(&gaussians).expect("written");
        let named = activated(&format!("a{}", format.ending), &bytes).expect("read");
        let found = activated("a.model", &bytes);
        if format.is_for_old_viewers {
            // Rows of numbers start with nothing of their own.
            let message = found.map(drop).expect_err("refused");
            for part in [
                "a.model",
                "not of a known format",
                ".compressed.ply",
                ".glb",
            ] {
                assert!(message.contains(part), "{message}");
            }
        } else {
            assert_eq!(found.expect("read"), named, "{}", format.name);
        }
    }
    let ply = by_name("ply").expect("a format");
    let bytes = (ply.write)(&gaussians).expect("written");
    let renamed = activated("a.splat", &bytes).expect("read");
    assert_eq!(renamed, activated("a.ply", &bytes).expect("read"));
    for other in [&b""[..], b"KSPLAT", b"{\"asset\": {}}"] {
        let message = activated("a.ksplat", other).map(drop).expect_err("refused");
        assert!(message.contains("not of a known format"), "{message}");
    }
}

//! Files that are written and read back, and files of other programs that are accepted or refused by name.

use omnilife_schemas::points::PointCloud;

use super::*;
use omnilife_engine::gaussians::static_gaussians::InitialGaussians;

const NORMALIZATION: Similarity = Similarity::new([10.0, 20.0, 30.0], 0.5);

fn table(sh_degree: usize) -> ParameterTable {
    let initial = InitialGaussians::isotropic(
        vec![[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]],
        &[0.25, 2.0],
        vec![[0.5; 3], [0.1, 0.2, 0.3]],
        vec![0.5, 0.9],
    );
    let mut table = static_gaussians::table(&initial, sh_degree);
    if let Some(rest) = table.arrays.get_mut(SH_REST) {
        for (index, value) in rest.values.iter_mut().enumerate() {
            *value = index as f32;
        }
    }
    table
}

#[test]
fn exports_world_coordinates() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    write(&path, &table(0), &NORMALIZATION)?;
    let positions = PointCloud::read_ply(&path)?.positions;
    assert_eq!(positions[0], [12.0, 24.0, 36.0]);
    let bytes = fs::read(&path)?;
    let rows = &bytes[bytes.len() - 2 * properties(0).len() * 4..];
    let scale = f32::from_le_bytes(rows.as_chunks::<4>().0[10]).exp();
    assert!(
        (scale - 0.5).abs() < 1e-6,
        "a quarter unit is half a world unit: {scale}"
    );
    Ok(())
}

#[test]
fn coefficients_are_written_channel_by_channel() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    write(&path, &table(1), &NORMALIZATION)?;
    let bytes = fs::read(&path)?;
    let names = properties(1);
    assert_eq!(names[9..18].join(" "), {
        let rest: Vec<String> = (0..9).map(|index| format!("f_rest_{index}")).collect();
        rest.join(" ")
    });
    let rows = bytes[bytes.len() - 2 * names.len() * 4..]
        .as_chunks::<4>()
        .0;
    let rest: Vec<f32> = rows[9..18].iter().map(|&w| f32::from_le_bytes(w)).collect();
    assert_eq!(rest, [0.0, 3.0, 6.0, 1.0, 4.0, 7.0, 2.0, 5.0, 8.0]);
    Ok(())
}

#[test]
fn what_is_written_is_read_back() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    for degree in 0..=3 {
        let written = table(degree);
        write(&path, &written, &NORMALIZATION)?;
        let mut invalid = InvalidGaussians::default();
        let read = read(&path, &NORMALIZATION, &mut invalid)?;
        assert_eq!(invalid, InvalidGaussians::default());
        for (a, b) in written.arrays.iter().zip(&read.arrays) {
            assert_eq!((a.name, a.width), (b.name, b.width));
            let error = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs());
            assert!(error.fold(0.0, f32::max) < 1e-5, "{} at {degree}", a.name);
        }
    }
    Ok(())
}

#[test]
fn what_is_missing_is_named() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    write(&path, &table(1), &NORMALIZATION)?;
    let whole = fs::read(&path)?;
    let refused = |bytes: Vec<u8>| -> Result<String, Box<dyn std::error::Error>> {
        fs::write(&path, bytes)?;
        Ok(
            read(&path, &NORMALIZATION, &mut InvalidGaussians::default())
                .map(drop)
                .expect_err("refused")
                .to_string(),
        )
    };
    let renamed = |from: &[u8], to: &[u8]| {
        assert_eq!(from.len(), to.len());
        let place = whole.windows(from.len()).position(|window| window == from);
        let mut bytes = whole.clone();
        let place = place.expect("the name is there");
        bytes[place..place + from.len()].copy_from_slice(to);
        bytes
    };
    assert!(refused(renamed(b"rot_3", b"rotor"))?.contains("has no property rot_3"));
    assert!(refused(renamed(b"opacity", b"opaqueX"))?.contains("has no property opacity"));
    assert!(refused(renamed(b"f_rest_8", b"g_rest_8"))?.contains("8 f_rest properties"));
    let mut nan = whole.clone();
    let last = nan.len() - 4;
    nan[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(refused(nan)?.contains("rot_3 of Gaussian 1 is not finite"));
    assert!(refused(whole[..whole.len() - 1].to_vec())?.contains("ends after 1 of 2"));
    // A count beyond the file's size must not cause an allocation.
    let many = renamed(b"vertex 2\n", b"vertex 9\n");
    assert!(refused(many)?.contains("ends after 2 of 9"));
    Ok(())
}
fn text(columns: &[&str], rows: &[Vec<f64>]) -> String {
    let count = rows.len();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {count}\n");
    for column in columns {
        text += &format!("property double {column}\n");
    }
    text += "end_header\n";
    for row in rows {
        let words: Vec<String> = row.iter().map(f64::to_string).collect();
        text += &(words.join(" ") + "\n");
    }
    text
}

const COLUMNS: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];

/// Returns a Gaussian with another value in one column.
fn with(column: &str, value: f64) -> Vec<f64> {
    let mut row = vec![
        1.0, 2.0, 3.0, 0.1, 0.2, 0.3, -0.5, -3.0, -4.0, -5.0, 1.0, 0.0, 0.0, 0.0,
    ];
    let place = COLUMNS.iter().position(|name| *name == column);
    row[place.expect("a column")] = value;
    row
}

fn read_text(text: &str) -> Result<(ParameterTable, InvalidGaussians), String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.ply");
    fs::write(&path, text).expect("written");
    let mut invalid = InvalidGaussians::default();
    read(&path, &NORMALIZATION, &mut invalid)
        .map(|table| (table, invalid))
        .map_err(|error| error.to_string())
}

#[test]
fn what_is_valid_is_taken_and_what_is_not_is_counted() -> Result<(), String> {
    let (minus, plus) = (f64::NEG_INFINITY, f64::INFINITY);
    let rows = [
        with("x", 4.0),
        with("opacity", plus),
        with("opacity", minus),
        with("rot_0", 0.0),
        with("scale_1", minus),
        with("z", minus),
        with("y", 1e60),
        vec![0.0; 14],
    ];
    let (table, invalid) = read_text(&text(&COLUMNS, &rows))?;
    let expected = InvalidGaussians {
        padding: 1,
        transparent: 1,
        out_of_reach: 2,
        unrotated: 1,
        flat: 1,
        ..InvalidGaussians::default()
    };
    assert_eq!((table.len(), invalid), (4, expected));
    let mut gaussians = omnilife_engine::gaussians::ActivatedGaussians::default();
    static_gaussians::activate(&table, &mut gaussians);
    assert_eq!(gaussians.opacities[1], 1.0);
    assert_eq!(gaussians.rotations[2], [1.0, 0.0, 0.0, 0.0]);
    let [_, thin, other] = gaussians.scales[3];
    assert!(thin > 0.0 && thin < 1e-6 * other, "{thin} {other}");
    for (column, value) in [
        ("x", f64::NAN),
        ("opacity", f64::NAN),
        ("scale_2", plus),
        ("scale_2", f64::NAN),
        ("rot_1", plus),
        ("f_dc_1", minus),
        ("f_dc_2", 1e60),
    ] {
        let refusal = read_text(&text(&COLUMNS, &[with("x", 0.0), with(column, value)]));
        let message = refusal.map(drop).expect_err("refused");
        let expected = format!("{column} of Gaussian 1 is not finite");
        assert!(message.contains(&expected), "{message}");
    }
    Ok(())
}

#[test]
fn what_looks_activated_is_told_and_read_as_it_is() -> Result<(), String> {
    let row = |size: f64, opacity: f64| {
        let mut row = with("opacity", opacity);
        row[7..10].fill(size);
        row
    };
    let padded = |rows: &[Vec<f64>]| text(&COLUMNS, &[rows, &[vec![0.0; 14]]].concat());
    let (table, invalid) = read_text(&padded(&[row(0.02, 0.9), row(0.3, 1.0)]))?;
    assert!(invalid.looks_activated);
    assert_eq!(table.row(OPACITY_LOGITS, 0), [0.9_f32]);
    let (_, invalid) = read_text(&padded(&[row(0.02, 0.9), row(-3.0, 1.0)]))?;
    assert!(!invalid.looks_activated);
    let (_, invalid) = read_text(&padded(&[]))?;
    assert!(!invalid.looks_activated, "padding says nothing");
    Ok(())
}

/// Returns rows with further columns of these values.
fn widened(names: &[&str], rows: &[(Vec<f64>, Vec<f64>)]) -> String {
    let rows: Vec<Vec<f64>> = rows
        .iter()
        .map(|(row, further)| [&row[..], &further[..]].concat())
        .collect();
    text(&[&COLUMNS[..], names].concat(), &rows)
}

/// Sizes and opacity as `scene/gaussian_model.py` of Mip-Splatting has them, from variances and their determinants.
#[test]
fn the_filter_of_mip_splatting_is_applied() -> Result<(), String> {
    let plain = with("x", 1.0);
    let sizes: [f64; 3] = [-3.0_f64, -4.0, -5.0].map(f64::exp);
    let opacity = 1.0 / (1.0 + 0.5_f64.exp());
    for filter in [0.001, 0.05, 2.0] {
        let rows = [(plain.clone(), vec![filter]), (plain.clone(), vec![0.0])];
        let (table, invalid) = read_text(&widened(&["filter_3D"], &rows))?;
        let expected = InvalidGaussians {
            smoothed: 1,
            ..InvalidGaussians::default()
        };
        assert_eq!(invalid, expected);
        let mut gaussians = omnilife_engine::gaussians::ActivatedGaussians::default();
        static_gaussians::activate(&table, &mut gaussians);
        let variances = sizes.map(|size| size * size + filter * filter);
        let ratio = sizes.map(|size| size * size).iter().product::<f64>()
            / variances.iter().product::<f64>();
        let near = |found: f32, truth: f64| (f64::from(found) - truth).abs() < 1e-5 * truth;
        for (found, variance) in gaussians.scales[0].iter().zip(variances) {
            // Half a unit of the normalized scene is a unit of the file.
            assert!(near(*found, 0.5 * variance.sqrt()), "{found} at {filter}");
        }
        let (found, truth) = (gaussians.opacities[0], opacity * ratio.sqrt());
        assert!(near(found, truth), "{found}, not {truth}, at {filter}");
        assert!(near(gaussians.opacities[1], opacity));
        for (found, size) in gaussians.scales[1].iter().zip(sizes) {
            assert!(near(*found, 0.5 * size), "{found} without a filter");
        }
    }
    // Logits whose sigmoid is 0 or 1 in f64 stay finite.
    for logit in [-900.0, 900.0] {
        let rows = [(with("opacity", logit), vec![1e-9])];
        let (table, _) = read_text(&widened(&["filter_3D"], &rows))?;
        let found = table.row(OPACITY_LOGITS, 0)[0];
        assert!(found.is_finite() && f64::from(found) <= logit, "{found}");
    }
    for size in [-0.1, f64::NAN, f64::INFINITY] {
        let rows = [(plain.clone(), vec![0.1]), (plain.clone(), vec![size])];
        let refusal = read_text(&widened(&["filter_3D"], &rows));
        let message = refusal.map(drop).expect_err("refused");
        assert!(message.contains("filter_3D of Gaussian 1"), "{message}");
    }
    Ok(())
}

#[test]
fn properties_that_are_not_read_are_listed() -> Result<(), String> {
    let row = (with("x", 1.0), vec![7.0; 5]);
    let names = ["nx", "red", "trbf_center", "alpha", "motion_0"];
    let (table, invalid) = read_text(&widened(&names, std::slice::from_ref(&row)))?;
    assert_eq!(invalid.unread_properties, ["trbf_center", "motion_0"]);
    let notes = validity::notes(Path::new("a.ply"), &invalid);
    assert_eq!(notes.len(), 1);
    assert!(notes[0].contains("trbf_center, motion_0"), "{notes:?}");
    let (plain, invalid) = read_text(&text(&COLUMNS, &[row.0]))?;
    assert_eq!(invalid, InvalidGaussians::default());
    assert_eq!(table, plain);
    Ok(())
}

#[test]
fn other_kinds_of_ply_are_called_by_their_names() {
    let without = |left_out: &[&str]| {
        let columns = COLUMNS.iter().filter(|name| !left_out.contains(name));
        text(&columns.copied().collect::<Vec<_>>(), &[])
    };
    let of_chunks = without(&[]).replace("element vertex", "element chunk 1\nelement vertex");
    for (text, expected) in [
        (without(&["scale_2"]), "2D Gaussians"),
        (without(&COLUMNS[3..]), "a point cloud"),
        (without(&COLUMNS[6..]), "a point cloud"),
        (without(&["f_dc_1"]), "has no property f_dc_1"),
        (of_chunks, "compressed PLY"),
    ] {
        let message = read_text(&text).map(drop).expect_err("refused");
        assert!(message.contains(expected), "{message}");
    }
}

/// Checks scenes at any place: the file's positions are floats near the origin, as all programs read them.
#[test]
fn runs_far_from_the_origin_are_read_back() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    let written = table(1);
    for (offset, scale, kind) in [
        ([0.0; 3], 0.01, "float"),
        ([-70.0, 3.0, 0.0], 0.5, "float"),
        ([5e5, 5e6, 0.0], 0.2, "double"),
        ([4.2e6, 1.7e5, -4.8e6], 3.0, "double"),
    ] {
        let normalization = Similarity { offset, scale };
        write(&path, &written, &normalization)?;
        let bytes = fs::read(&path)?;
        let header = String::from_utf8_lossy(&bytes[..200]).into_owned();
        assert!(header.contains(&format!("property {kind} z\nproperty float nx")));
        let read = read(&path, &normalization, &mut InvalidGaussians::default())?;
        for (a, b) in written.arrays.iter().zip(&read.arrays) {
            let error = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs());
            assert!(error.fold(0.0, f32::max) < 1e-5, "{} at {offset:?}", a.name);
        }
        let origin = origin(&path, &bytes)?;
        let middle = DVec3::from_array(offset);
        if kind == "float" {
            assert_eq!(origin, DVec3::ZERO);
        } else {
            assert!(origin.distance(middle) < 10.0 / scale, "{origin}");
        }
    }
    Ok(())
}

#[test]
fn positions_out_of_reach_do_not_move_the_origin() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("gaussians.ply");
    let near = [
        [7e5, 3e6, -20.0],
        [700_000.7, 3e6, -21.3],
        [7e5, 3_000_000.9, -19.0],
    ];
    let far = [
        [f64::INFINITY, 0.0, 0.0],
        [0.0, f64::NEG_INFINITY, 0.0],
        [1e25, 1e25, 0.0],
        [-1e300, 0.0, 4.0],
    ];
    let origin_of = |places: &[[f64; 3]]| -> Result<DVec3, Box<dyn std::error::Error>> {
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", places.len());
        text += "property double x\nproperty double y\nproperty double z\nend_header\n";
        for [x, y, z] in places {
            text += &format!("{x} {y} {z}\n");
        }
        Ok(origin(&path, text.as_bytes())?)
    };
    let of_near = origin_of(&near)?;
    assert!(
        of_near.distance(DVec3::from_array(near[0])) < 2.0,
        "{of_near}"
    );
    assert_eq!(origin_of(&[&near[..], &far].concat())?, of_near);
    assert_eq!(origin_of(&far)?, DVec3::ZERO);
    Ok(())
}

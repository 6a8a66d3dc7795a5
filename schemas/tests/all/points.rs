//! Point clouds as PLY files.

use std::{fs, path::Path};

use omnilife_schemas::points::{Coordinates, PointCloud};
use proptest::prelude::*;

fn clouds() -> impl Strategy<Value = PointCloud> {
    let coordinate = || prop_oneof![-1e6_f32..1e6, -1e-6_f32..1e-6];
    prop::collection::vec(
        (prop::array::uniform3(coordinate()), any::<[u8; 3]>()),
        0..50,
    )
    .prop_map(|points| {
        let points = points.into_iter();
        let (positions, colours) = points
            .map(|(position, colour)| (position.map(f64::from), colour))
            .unzip();
        PointCloud { positions, colours }
    })
}

fn read(folder: &Path, content: &[u8]) -> Result<PointCloud, String> {
    let path = folder.join("points.ply");
    fs::write(&path, content).unwrap();
    PointCloud::read_ply(&path).map_err(|error| {
        let message = error.to_string();
        assert!(
            message.starts_with(&path.display().to_string()),
            "{message}"
        );
        assert!(!message.contains('\n'), "{message}");
        message
    })
}

fn ascii(header: &str, body: &str) -> String {
    format!("ply\nformat ascii 1.0\n{header}\nend_header\n{body}")
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z";

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn clouds_come_back(cloud in clouds()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        cloud.write_ply(&path).unwrap();
        prop_assert_eq!(PointCloud::read_ply(&path).unwrap(), cloud);
    }

    #[test]
    fn clouds_far_from_the_origin_come_back(
        offset in prop::array::uniform3(-7e6_f64..7e6),
        exponent in -3.0..4.0,
        places in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 2..40),
    ) {
        let extent = 10.0_f64.powf(exponent);
        let at = |place: &[f64; 3]| [0, 1, 2].map(|axis| offset[axis] + extent * place[axis]);
        let cloud = PointCloud::of_colour(places.iter().map(at).collect(), [1, 2, 3]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        cloud.write_ply(&path).unwrap();
        let back = PointCloud::read_ply(&path).unwrap();
        prop_assert_eq!(back.len(), cloud.len());
        let values = cloud.positions.as_flattened().iter().zip(back.positions.as_flattened());
        for (written, read) in values {
            prop_assert!((written - read).abs() <= 2e-5 * extent, "{} {}", written, read);
        }
    }

    #[test]
    fn every_truncation_is_told(cloud in clouds(), share in 0.0..1.0) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        cloud.write_ply(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        let header = bytes.windows(10).position(|w| w == b"end_header").unwrap();
        let cut = (share * bytes.len() as f64) as usize;
        // A cut inside the words "end_header" or after the last point is not a loss.
        prop_assume!(cut < header || (cut > header + 11 && cut < bytes.len()));
        prop_assert!(read(folder.path(), &bytes[..cut]).is_err());
    }

    #[test]
    fn garbage_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let folder = tempfile::tempdir().unwrap();
        prop_assert!(read(folder.path(), &bytes).is_err());
        let mut with_header = ascii(&format!("element vertex 3\n{XYZ}"), "").into_bytes();
        with_header.extend(&bytes);
        // Numbers may come out of chance bytes; a panic may not.
        drop(read(folder.path(), &with_header));
    }
}

#[test]
fn ascii_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let text = ascii(
        "comment the word end_header in a comment\nelement vertex 2\nproperty double x\n\
         property float y\nproperty float z\nproperty float nx\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nelement face 1\n\
         property list uchar int vertex_indices",
        "1 -2.5 3e2 0 255 0 7\n\n  4 5 6 0 1 2 3\n3 0 1 1\n",
    );
    let cloud = read(folder.path(), text.as_bytes()).unwrap();
    assert_eq!(cloud.positions, [[1.0, -2.5, 300.0], [4.0, 5.0, 6.0]]);
    assert_eq!(cloud.colours, [[255, 0, 7], [1, 2, 3]]);
    let windows = text.replace('\n', "\r\n");
    assert_eq!(read(folder.path(), windows.as_bytes()).unwrap(), cloud);
}

/// Coordinates are floats as long as these suffice, because all programs read them.
#[test]
fn coordinates_are_doubles_where_floats_would_lose_the_scene() {
    let wave = |n: u32| (0.7 * f64::from(n)).sin();
    let around = |offset: f64| -> Vec<[f64; 3]> {
        let at = |n: u32| [wave(n), offset + wave(n + 50), 3.0 * wave(n + 90)];
        (0..40).map(at).collect()
    };
    for (positions, expected) in [
        (Vec::new(), Coordinates::Float),
        (around(0.0), Coordinates::Float),
        (around(10.0), Coordinates::Float),
        (around(5e5), Coordinates::Double),
        (around(-6.4e6), Coordinates::Double),
        // Rounded already: nothing is left to lose.
        (vec![[4e6, 0.5, -7.0]; 3], Coordinates::Float),
        (vec![[4e6 + 0.1, 0.5, -7.0]; 3], Coordinates::Double),
        // A few points far out do not stretch the extent of the scene.
        (
            [around(5e5), vec![[1e9; 3]; 3]].concat(),
            Coordinates::Double,
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        assert_eq!(Coordinates::of(&positions), expected);
        let cloud = PointCloud::of_colour(positions, [0; 3]);
        cloud.write_ply(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        let property = format!("property {} x\n", expected.ply_type());
        assert!(
            bytes
                .windows(property.len())
                .any(|at| at == property.as_bytes())
        );
        if expected == Coordinates::Double {
            assert_eq!(PointCloud::read_ply(&path).unwrap(), cloud);
        }
    }
}

#[test]
fn points_without_colours_are_grey() {
    let folder = tempfile::tempdir().unwrap();
    let text = ascii(&format!("element vertex 1\n{XYZ}"), "1 2 3\n");
    assert_eq!(
        read(folder.path(), text.as_bytes()).unwrap().colours,
        [[128; 3]]
    );
    let none = ascii(&format!("element vertex 0\n{XYZ}"), "");
    assert!(read(folder.path(), none.as_bytes()).unwrap().is_empty());
}

#[test]
fn colours_have_the_names_that_programs_give_them() {
    let folder = tempfile::tempdir().unwrap();
    let colours = |names: &[&str], values: &str| {
        let names = names.iter().map(|name| format!("\nproperty uchar {name}"));
        let head = format!("element vertex 1\n{XYZ}{}", names.collect::<String>());
        let text = ascii(&head, &format!("1 2 3 {values}\n"));
        read(folder.path(), text.as_bytes()).unwrap().colours
    };
    for names in [
        ["red", "green", "blue"],
        ["diffuse_red", "diffuse_green", "diffuse_blue"],
        ["r", "g", "b"],
    ] {
        assert_eq!(colours(&names, "200 100 50"), [[200, 100, 50]], "{names:?}");
    }
    // Names of two kinds are no colour, and the usual ones win.
    assert_eq!(colours(&["red", "g", "b"], "9 9 9"), [[128; 3]]);
    let both = ["r", "g", "b", "blue", "green", "red"];
    assert_eq!(colours(&both, "9 9 9 3 2 1"), [[1, 2, 3]]);
}

#[test]
fn faults_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let vertex =
        |properties: &str, body: &str| ascii(&format!("element vertex 2\n{properties}"), body);
    for (content, reason) in [
        (vertex(XYZ, "1 2 3\n"), "PLY ends after 1 of 2 points"),
        (vertex(XYZ, "1 2 3\n1 2\n"), "point 1 has too few values"),
        (
            vertex(XYZ, "1 2 3\n1 2 x\n"),
            "point 1 is not a row of numbers",
        ),
        (vertex(XYZ, "1 2 3\n1 2 nan\n"), "point 1 is not finite"),
        (vertex(XYZ, "1 2 3\n1 2 1e60\n"), "point 1 is not finite"),
        (vertex("property float x", "1\n2\n"), "no x, y, z"),
        (
            vertex("property int128 x", "1\n2\n"),
            "PLY type int128 is not known",
        ),
        (
            vertex(
                &format!("{XYZ}\nproperty float red\nproperty float green\nproperty float blue"),
                "1 2 3 0.5 0.5 0.5\n1 2 3 0 0 0\n",
            ),
            "PLY colours are not uchar",
        ),
        (
            ascii("element face 1\nelement vertex 1", ""),
            "first PLY element is face, not vertex",
        ),
        (
            ascii(
                "element chunk 1\nproperty float min_x\nelement vertex 256",
                "",
            ),
            "compressed PLY",
        ),
        (ascii("element vertex many", ""), "count is not a number"),
        (ascii("", ""), "no vertices"),
        (
            "ply\nformat binary_big_endian 1.0\nelement vertex 1\nend_header\n".to_owned(),
            "binary_big_endian is not supported",
        ),
        ("solid cube\n".to_owned(), "not a PLY file"),
        (String::new(), "not a PLY file"),
        (
            format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{XYZ}\nend_header\n",
                u64::MAX
            ),
            "PLY ends after 0 of",
        ),
    ] {
        let message = read(folder.path(), content.as_bytes()).unwrap_err();
        assert!(message.contains(reason), "{message}");
    }
}

//! Assignment of poses and times to images of another program.

use omnilife_schemas::records::{PosedFrame, Poses};

use super::{
    foreign::{ColmapRow, Foreign, assert_poses, notes, pose, write_colmap_text},
    *,
};

const SPHERE: &str = "1 EQUIRECTANGULAR 24 12 24 12\n";
const SIZE: [u32; 2] = [24, 12];

/// A COLMAP model of panoramas with these images by their id, name and frame.
fn colmap(rows: &[(u32, &str, u8)]) -> Foreign {
    let images: Vec<(String, u8)> = rows
        .iter()
        .map(|(_, name, number)| (format!("images/{name}"), *number))
        .collect();
    let images: Vec<(&str, u8)> = images.iter().map(|(name, n)| (name.as_str(), *n)).collect();
    let foreign = Foreign::new(SIZE, &images);
    let rows: Vec<ColmapRow<'_>> = rows.iter().map(|&(id, name, n)| (id, 1, name, n)).collect();
    write_colmap_text(&foreign, "sparse/0", SPHERE, &rows);
    foreign
}

#[test]
fn rows_of_arrays_belong_to_numbers() {
    let numbered = |first: u8, names: &dyn Fn(u8) -> String| {
        let images: Vec<(String, u8)> = (0..11)
            .map(|n| (format!("pano/{}", names(n + first)), n))
            .collect();
        let images: Vec<(&str, u8)> = images.iter().map(|(name, n)| (name.as_str(), *n)).collect();
        let foreign = Foreign::new(SIZE, &images);
        let (mut rotations, mut centres) = (Vec::new(), Vec::new());
        for n in 0..11_u8 {
            // x left, y up, z forward; f32 keeps these numbers.
            rotations.extend([-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0_f32]);
            centres.extend([f32::from(n), 0.5, -2.0]);
        }
        let at = |name: &str| foreign.path().join("in").join(name);
        npy::write_f32(&at("rotation.npy"), &[11, 3, 3], &rotations).unwrap();
        npy::write_f32(&at("translation.npy"), &[11, 3], &centres).unwrap();
        foreign
    };
    for first in [0, 1] {
        let foreign = numbered(first, &|n| format!("{n}.png"));
        let scene = foreign.import("hm3d").unwrap();
        let expected: Vec<(u8, i64)> = (0..11).map(|n| (n, 10 * i64::from(n))).collect();
        assert_eq!(foreign.shown(&scene), expected);
        for (n, frame) in (0_u8..).zip(&scene.frames) {
            let pose = frame.pose.unwrap();
            assert!(pose.centre().distance(dvec3(f64::from(n), 0.5, -2.0)) < 1e-9);
            assert!((pose.rotation().unwrap() * DVec3::Z).distance(DVec3::Z) < 1e-9);
        }
    }
    for names in [
        &(|n: u8| format!("{}.png", 2 * n)) as &dyn Fn(u8) -> String,
        &|n: u8| format!("{}.png", n + 5),
        &|n: u8| {
            format!(
                "{}.png",
                ["a", "b", "c"][usize::from(n) % 3].repeat(usize::from(n) + 1)
            )
        },
    ] {
        assert!(numbered(0, names).refusal("hm3d").contains("pano"));
    }
}

#[test]
fn poses_without_names_belong_to_numbers() {
    let written = |names: &[&str]| {
        let images: Vec<String> = names.iter().map(|name| format!("rgb/{name}")).collect();
        let images: Vec<(&str, u8)> = images.iter().map(String::as_str).zip(0..).collect();
        let foreign = Foreign::new(SIZE, &images);
        let poses = Poses::new(
            Scale::Arbitrary,
            Some(ErpCamera::new(24, 12).into()),
            (0..images.len() as u8)
                .map(|n| PosedFrame::new(f64::from(n), pose(n)))
                .collect(),
        );
        store::write_record(&foreign.path().join("in/poses.json"), &poses).unwrap();
        foreign
    };
    let all: Vec<String> = (1..=12).map(|n| format!("shot_{n}.png")).collect();
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let foreign = written(&all);
    let scene = foreign.import("frames").unwrap();
    let numbers: Vec<u8> = (0..12).collect();
    assert_poses(&scene, &numbers);
    let shown: Vec<u8> = foreign.shown(&scene).iter().map(|(n, _)| *n).collect();
    assert_eq!(shown, numbers);
    // With gaps, names of one length have one order; others do not.
    let padded = written(&["003.png", "007.png", "020.png"]);
    assert_poses(&padded.import("frames").unwrap(), &[0, 1, 2]);
    assert!(
        written(&["3.png", "7.png", "20.png"])
            .refusal("frames")
            .contains("order")
    );
}

#[test]
fn times_follow_numbers_and_not_the_order_of_registration() {
    let foreign = colmap(&[
        (9, "cut_003.png", 3),
        (2, "cut_011.png", 4),
        (4, "cut_001.png", 1),
        (1, "cut_002.png", 2),
    ]);
    let scene = foreign.import("colmap").unwrap();
    assert_eq!(foreign.shown(&scene), [(1, 0), (2, 10), (3, 20), (4, 100)]);
    assert_poses(&scene, &[1, 2, 3, 4]);
    // An image that was not registered is the first of the clip, and is told.
    foreign.paint("images/cut_000.png", |_, _| [0; 3]);
    let scene = foreign.import("colmap").unwrap();
    assert_eq!(foreign.shown(&scene), [(1, 10), (2, 20), (3, 30), (4, 110)]);
    assert!(notes(&scene, "cut_000.png"));

    let unpadded = colmap(&[(1, "f10.png", 10), (2, "f9.png", 9), (3, "f8.png", 8)]);
    let scene = unpadded.import("colmap").unwrap();
    assert_eq!(unpadded.shown(&scene), [(8, 0), (9, 10), (10, 20)]);
    let unnumbered = colmap(&[(1, "door.png", 2), (2, "arch.png", 1)]);
    let scene = unnumbered.import("colmap").unwrap();
    assert_eq!(unnumbered.shown(&scene), [(1, 0), (2, 10)]);
    assert!(notes(&scene, "follow the order of the names"));
}

#[test]
fn a_table_of_times_has_a_row_for_every_image_and_no_other() {
    let foreign = colmap(&[(1, "a5.png", 5), (2, "a6.png", 6), (3, "a7.png", 7)]);
    let table =
        |rows: &str| foreign.write("times.csv", format!("\u{feff}image,time_seconds\n{rows}"));
    table("a7.png,0.5\na5.png,2\na6.png,1.25\n");
    let scene = foreign.import("colmap").unwrap();
    assert_eq!(foreign.shown(&scene), [(7, 50), (6, 125), (5, 200)]);
    assert_poses(&scene, &[7, 6, 5]);
    for (rows, named) in [
        ("a5.png,0\na7.png,1\n", "a6.png"),
        ("a5.png,0\na6.png,1\na7.png,2\na8.png,3\n", "a8.png"),
        ("a5.png,0\na6.png,1\nb7.png,2\n", "b7.png"),
        ("b5.png,0\nb6.png,1\n", "b5.png"),
    ] {
        table(rows);
        let line = foreign.refusal("colmap");
        assert!(line.contains(named) && line.contains("times.csv"), "{line}");
    }
}

/// COLMAP since 3.12 says which images a rig took at once.
#[test]
fn views_of_a_rig_share_their_time() {
    let rows = [
        (1, "left/4.png", 1),
        (2, "left/5.png", 2),
        (3, "right/4.png", 3),
        (4, "right/5.png", 4),
    ];
    let foreign = colmap(&rows);
    let frames = |pairs: [[u32; 2]; 2]| {
        let lines = pairs.iter().enumerate().map(|(frame, [a, b])| {
            format!("{frame} 1 1 0 0 0 0 0 0 2 CAMERA 1 {a} CAMERA 2 {b}\n")
        });
        let lines: String = lines.collect();
        foreign.write(
            "sparse/0/frames.txt",
            format!("# Frame list with one line of data per frame:\n{lines}"),
        );
    };
    frames([[1, 3], [2, 4]]);
    let scene = foreign.import("colmap").unwrap();
    assert_eq!(foreign.shown(&scene), [(1, 0), (3, 0), (2, 10), (4, 10)]);
    frames([[1, 4], [2, 3]]);
    let line = foreign.refusal("colmap");
    assert!(
        line.contains("left/5.png") && line.contains("right/4.png"),
        "{line}"
    );
    foreign.write("sparse/0/frames.txt", "0 1 1 0 0 0 0 0 0 2 CAMERA 1 1\n");
    assert!(foreign.refusal("colmap").contains("frames.txt: line 1"));
}

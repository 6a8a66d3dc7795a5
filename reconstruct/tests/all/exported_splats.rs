//! Exported Gaussians: any export is read again, with odd values of its source too, and rendered like its source.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec3};
use omnilife_reconstruct::{
    formats::{
        exchange::{self, SPLAT_FORMATS},
        splat::{self, Placement},
    },
    jobs::{
        camera_words::CameraWords,
        export::{ExportRequest, ExportResult, export, levels::Level},
        render::{RenderCamera, RenderRequest, render_poses},
    },
};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    progress::{Progress, Silent},
    records::{AssetPlacement, InvalidGaussians, PosedFrame, Poses, Scale},
    store,
    testing::Notes,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// x y z, `f_dc`, opacity, `scale`, `rot`.
type Row = [f32; 14];

const COLUMNS: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];
const SOUND: Row = [
    0.5, -1.0, 2.0, 0.1, 0.2, -0.3, 2.0, -2.0, -2.5, -2.2, 0.9, 0.1, -0.3, 0.2,
];

fn write_ply(path: &Path, rows: &[Row]) {
    let count = rows.len();
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    for column in COLUMNS {
        header += &format!("property float {column}\n");
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    bytes.extend(
        rows.as_flattened()
            .iter()
            .flat_map(|value| value.to_le_bytes()),
    );
    fs::write(path, bytes).unwrap();
}

fn exported(source: &Path, out: PathBuf, progress: &dyn Progress) -> ExportResult {
    export(&request(source, "splat", out), progress).unwrap()
}

fn request(source: &Path, format: &str, out: PathBuf) -> ExportRequest {
    let level = |name: &str, most| Level {
        name: name.to_owned(),
        most,
    };
    ExportRequest {
        gaussians: source.to_owned(),
        format: format.to_owned(),
        levels: vec![level("full", None), level("5", Some(5))],
        with_page: false,
        up: None,
        time_seconds: None,
        moments: None,
        out,
    }
}

fn placement(of: &AssetPlacement) -> Placement {
    let [w, x, y, z] = of.rotation_wxyz;
    Placement {
        offset: DVec3::from_array(of.offset),
        scale: of.scale,
        rotation: DQuat::from_xyzw(x, y, z, w),
    }
}

/// Generates ordinary values, and sometimes one of others.
fn with_odd(ordinary: std::ops::Range<f32>, odd: &[f32]) -> impl Strategy<Value = f32> + use<> {
    prop_oneof![12 => ordinary, 1 => prop::sample::select(odd.to_vec())]
}

fn odd_row() -> impl Strategy<Value = Row> {
    const INF: f32 = f32::INFINITY;
    let place = || with_odd(-3.0..3.0, &[0.0, 1e7, 1e-30, -1e17, 3e19, -1e30, INF, -INF]);
    let size = || with_odd(-4.0..-0.5, &[0.0, -87.0, -200.0, 60.0, 1e30, -INF]);
    let quaternion = prop_oneof![
        8 => prop::array::uniform4(-1.0_f32..1.0),
        1 => Just([0.0; 4]),
        1 => Just([1e-30, 0.0, -1e-30, 0.0]),
        1 => Just([1e20, -1e20, 0.0, 0.0]),
    ];
    let colour = prop::array::uniform3(-2.0_f32..2.0);
    let opacity = with_odd(-2.0..4.0, &[0.0, INF, -INF, 100.0, -100.0]);
    let row = (
        [place(), place(), place()],
        colour,
        opacity,
        [size(), size(), size()],
        quaternion,
    );
    let row = row.prop_map(|([x, y, z], [r, g, b], opacity, [a, s, t], [q, i, j, k])| {
        [x, y, z, r, g, b, opacity, a, s, t, q, i, j, k]
    });
    prop_oneof![12 => row, 1 => Just([0.0; 14])]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn whatever_is_exported_is_read(odd in prop::collection::vec(odd_row(), 0..40)) {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("a.ply");
        let out = folder.path().join("asset");
        let rows = [&odd[..], &[SOUND]].concat();
        write_ply(&source, &rows);
        let asset = exported(&source, out.clone(), &Silent).asset;
        let invalid = &asset.invalid;
        let left_out = invalid.padding + invalid.transparent + invalid.out_of_reach;
        let all = asset.splats + asset.changes.transparent + left_out;
        prop_assert_eq!(all, rows.len() as u64);
        let world = Similarity { offset: [0.0; 3], scale: 1.0 };
        for level in &asset.levels {
            for placement in [placement(&asset.placement), Placement::WORLD] {
                let mut invalid = InvalidGaussians::default();
                let path = out.join(&level.file);
                let table = splat::read(&path, &placement, &world, &mut invalid).unwrap();
                prop_assert_eq!(invalid, InvalidGaussians::default());
                prop_assert_eq!(table.len() as u64, level.splats);
                for array in &table.arrays {
                    prop_assert!(array.values.iter().all(|value| value.is_finite()), "{}", array.name);
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn whatever_is_exported_as_it_is_is_read(odd in prop::collection::vec(odd_row(), 0..40)) {
        let folder = tempfile::tempdir().unwrap();
        let source = folder.path().join("a.ply");
        write_ply(&source, &[&odd[..], &[SOUND]].concat());
        let world = Similarity { offset: [0.0; 3], scale: 1.0 };
        for format in SPLAT_FORMATS.iter().filter(|format| !format.is_for_old_viewers) {
            let out = folder.path().join(format.name);
            let asset = match export(&request(&source, format.name, out.clone()), &Silent) {
                Ok(exported) => exported.asset,
                Err(error) => {
                    // SPZ has 24 bits for a coordinate.
                    let message = error.to_string();
                    prop_assert!(format.name.starts_with("spz") && message.contains("reaches"), "{}", message);
                    continue;
                }
            };
            for level in &asset.levels {
                for placement in [placement(&asset.placement), Placement::WORLD] {
                    let mut invalid = InvalidGaussians::default();
                    let path = out.join(&level.file);
                    let table = exchange::read(&path, &placement, &world, &mut invalid).unwrap();
                    prop_assert_eq!(invalid, InvalidGaussians::default());
                    prop_assert_eq!(table.len() as u64, level.splats);
                    for array in &table.arrays {
                        prop_assert!(array.values.iter().all(|value| value.is_finite()), "{}", array.name);
                    }
                }
            }
        }
    }
}

/// Renders an image of a model from the origin.
fn drawn(model: &Path, folder: &Path, progress: &dyn Progress) -> RgbImage {
    let poses = folder.join("poses.json");
    let record = Poses::new(
        Scale::Arbitrary,
        None,
        vec![PosedFrame::new(
            0.0,
            Pose::new(DQuat::IDENTITY, DVec3::ZERO),
        )],
    );
    store::write_record(&poses, &record).unwrap();
    let request = RenderRequest {
        model: model.to_owned(),
        axes: None,
        poses,
        cameras: CameraWords::default(),
        size: Some([64, 32]),
        camera: RenderCamera::OfPoses,
        layer: "all".to_owned(),
        cube_faces: None,
        out: folder.join(model.file_stem().unwrap()),
    };
    let views = render_poses(&request, progress).unwrap();
    RgbImage::read(&views.files[0]).unwrap()
}

fn mean_difference(a: &RgbImage, b: &RgbImage) -> f32 {
    let differences = a.data.iter().zip(&b.data).map(|(a, b)| (a - b).abs());
    255.0 * differences.sum::<f32>() / a.data.len() as f32
}

/// Returns Gaussians around the origin with odd values, and the same with their intended values.
fn odd_and_meant() -> [Vec<Row>; 2] {
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let (mut odd, mut meant) = (Vec::new(), Vec::new());
    for number in 0..300 {
        let mut signs = || random.random_range(-1.0_f32..1.0);
        // Not at one distance: in front of each other they are drawn in one order.
        let distance = 2.5 + 0.5 * signs();
        let mut row = SOUND.map(|_| signs());
        let length = row[..3]
            .iter()
            .map(|place| place * place)
            .sum::<f32>()
            .sqrt();
        for place in &mut row[..3] {
            *place *= distance / length;
        }
        row[6] += 1.0;
        for size in &mut row[7..10] {
            *size = -1.5 + 0.4 * *size;
        }
        let [mut as_written, mut as_meant] = [row; 2];
        if number % 10 == 0 {
            as_written[10..].fill(0.0);
            as_meant[10..].copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
        }
        if number % 7 == 0 {
            as_written[6] = f32::INFINITY;
            as_meant[6] = 30.0;
        }
        if number % 11 == 0 {
            as_written[6] = f32::NEG_INFINITY;
        } else {
            meant.push(as_meant);
        }
        odd.push(as_written);
    }
    odd.extend([[0.0; 14]; 40]);
    [odd, meant]
}

#[test]
fn odd_values_are_drawn_as_they_are_meant_and_so_is_what_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["odd.ply", "meant.ply"].map(|name| folder.path().join(name));
    for (path, rows) in paths.iter().zip(odd_and_meant()) {
        write_ply(path, &rows);
    }
    let told = Notes::default();
    let [odd, meant] = [&paths[0], &paths[1]].map(|path| drawn(path, folder.path(), &told));
    // Padding, opacities of 0 and quaternions of zeros of the one file; no notes on the other.
    assert_eq!(told.take().len(), 3);
    assert!(odd.data.iter().any(|value| *value > 0.2));
    assert_eq!(odd.data, meant.data);
    let told = Notes::default();
    let asset = exported(&paths[0], folder.path().join("asset"), &told).asset;
    assert_eq!(told.take().len(), 3);
    let expected = InvalidGaussians {
        padding: 40,
        transparent: 28,
        // Every tenth but those of opacity 0 among them.
        unrotated: 27,
        ..InvalidGaussians::default()
    };
    assert_eq!((asset.invalid, asset.splats), (expected, 272));
    let of_splats = drawn(
        &folder.path().join("asset/full.splat"),
        folder.path(),
        &Silent,
    );
    let difference = mean_difference(&odd, &of_splats);
    assert!(difference < 1.0, "{difference}");
}

/// Sizes and colours outside of the bytes of SPZ, and a thin axis that stays below a pixel.
#[test]
fn clamped_values_are_counted_and_told() {
    let temp = tempfile::tempdir().unwrap();
    let source = temp.path().join("a.ply");
    let (mut large, mut small, mut bright, mut thin) = (SOUND, SOUND, SOUND, SOUND);
    large[7] = 6.5;
    small[7..10].fill(-11.0);
    bright[3] = 4.0;
    thin[9] = -14.0;
    write_ply(&source, &[SOUND, large, small, bright, thin]);
    for (format, expected) in [
        ("spz", (2, 1)),
        ("spz-3", (2, 1)),
        ("compressed-ply", (0, 0)),
    ]
    .into_iter()
    .chain(["ply", "sog", "glb"].map(|format| (format, (0, 0))))
    {
        let out = temp.path().join(format);
        let mut request = request(&source, format, out);
        request.levels.truncate(1);
        let result = export(&request, &Silent).unwrap();
        let changes = &result.asset.changes;
        let clamped = (changes.clamped_sizes, changes.clamped_colours);
        assert_eq!(clamped, expected, "{format}");
        let told = result.notes.iter().filter(|note| note.contains("nearest"));
        let kinds = u64::from(expected.0 > 0) + u64::from(expected.1 > 0);
        assert_eq!(told.count() as u64, kinds, "{format}: {:?}", result.notes);
    }
}

//! Pixels of the layout, folders and compressed archives, and refused files.

use std::{fs, io::Write, path::Path};

use flate2::{Compression, Crc, write::DeflateEncoder};
use omnilife_schemas::{Similarity, records::InvalidGaussians};
use serde_json::{Value, json};

use super::{archive::Archive, *};
use crate::formats::{
    exchange::{
        self,
        tests::{activated, apart, varied},
    },
    splat::Placement,
};

/// Files of an archive by name.
type Contents = Vec<(&'static str, Vec<u8>)>;

fn contents(bytes: &[u8], degree: usize) -> Contents {
    let archive = Archive::open(bytes).expect("an archive");
    let images = IMAGES.iter().take(if degree == 0 { 5 } else { 7 });
    [RECORD_FILE]
        .iter()
        .chain(images)
        .map(|name| (*name, archive.file(name).expect("a file").into_owned()))
        .collect()
}

fn with_record(bytes: &[u8], change: impl Fn(&mut Value)) -> Vec<u8> {
    let mut files = contents(bytes, 3);
    let mut record: Value = serde_json::from_slice(&files[0].1).expect("a record");
    change(&mut record);
    files[0].1 = record.to_string().into_bytes();
    bundled(&files).expect("bundled")
}

/// Returns the archive with another image.
fn with_image(bytes: &[u8], name: &str, pixels: &[[u8; 4]], size: [usize; 2]) -> Vec<u8> {
    let mut files = contents(bytes, 3);
    let image = images::written(pixels, size).expect("an image");
    for file in files.iter_mut().filter(|(file, _)| *file == name) {
        file.1.clone_from(&image);
    }
    bundled(&files).expect("bundled")
}

#[test]
fn pixels_are_those_of_the_layout() {
    let mut gaussians = varied(2, 1);
    // On the curve through space in this order.
    gaussians.positions = vec![[-1.0, -1.0, -1.0], [1.0, 0.0, 3.0]];
    gaussians.rotations[0] = [0.5, -0.5, 0.5, -0.5];
    gaussians.rotations[1] = [0.0, 0.0, 0.0, -1.0];
    gaussians.scales = vec![[1.0, 2.0, 4.0], [4.0, 2.0, 1.0]];
    gaussians.opacities = vec![0.2, 0.999];
    gaussians.sh_constant = vec![[0.5, -0.5, 0.0], [0.0, 0.0, 0.0]];
    let bytes = write(&gaussians).expect("written");
    let files = contents(&bytes, 1);
    let record: Value = serde_json::from_slice(&files[0].1).expect("a record");
    assert_eq!(record["version"], 2);
    assert_eq!(record["count"], 2);
    let folded = 4.0_f64.ln();
    assert!((record["means"]["maxs"][2].as_f64().unwrap_or(0.0) - folded).abs() < 1e-12);
    for coded in ["scales", "sh0", "shN"] {
        let codebook = record[coded]["codebook"].as_array().map(Vec::len);
        assert_eq!(codebook, Some(256), "{coded}");
    }
    assert_eq!(record["shN"]["bands"], 1);
    assert_eq!(record["shN"]["count"], 2);
    let pixels = |at: usize, least: usize, side: [usize; 2]| -> Vec<[u8; 4]> {
        let check = |size: [usize; 2]| {
            assert_eq!(size, side);
            Ok(())
        };
        let mut pixels = images::pixels(&files[at].1, check).expect("an image");
        pixels.truncate(least);
        pixels
    };
    assert_eq!(pixels(1, 2, [4, 4]), [[0, 0, 0, 255], [255, 255, 255, 255]]);
    let upper = pixels(2, 2, [4, 4]);
    assert_eq!(upper, [[0, 0, 0, 255], [255, 255, 255, 255]]);
    assert_eq!(
        pixels(3, 2, [4, 4]),
        [[37, 218, 37, 252], [128, 128, 128, 255]]
    );
    assert_eq!(pixels(4, 2, [4, 4]), [[0, 1, 2, 255], [2, 1, 0, 255]]);
    assert_eq!(pixels(5, 2, [4, 4]), [[2, 0, 1, 51], [1, 1, 1, 255]]);
    assert_eq!(pixels(6, 3, [192, 1]).len(), 3);
    let labels = pixels(7, 2, [4, 4]);
    assert!(labels[0] != labels[1] && labels[0][1..] == [0, 0, 255]);
}

#[test]
fn rotations_keep_a_degree_at_their_poles() {
    for quaternion in [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, -1.0],
        [0.5, -0.5, 0.5, -0.5],
        [FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, 0.0],
        [-0.1, 0.7, 0.7, 0.1],
    ] {
        let found = unpacked(packed(quaternion)).unwrap_or_default();
        let length: f32 = (quaternion.iter().map(|part| part * part).sum::<f32>()).sqrt();
        let along: f32 = (found.iter().zip(quaternion))
            .map(|(a, b)| a * b / length)
            .sum();
        let squares = found.iter().zip(quaternion);
        let squares = squares.map(|(a, b)| (a - along.signum() * b / length).powi(2));
        assert!(
            squares.sum::<f32>().sqrt() < 0.008,
            "{quaternion:?} {found:?}"
        );
    }
    assert_eq!(unpacked([0, 0, 0, 251]), None);
}

#[test]
fn scenes_with_more_rows_than_the_palette_come_near() {
    let mut written = varied(3000, 2);
    // Harmonics of a few materials.
    for (number, row) in written.sh_rest.chunks_exact_mut(8).enumerate() {
        for (at, coefficient) in row.iter_mut().enumerate() {
            let value = (0.37 * (number % 40) as f32 + at as f32).sin();
            *coefficient = [0.6 * value, 0.3 * value, 0.001 * (number % 7) as f32];
        }
    }
    let bytes = write(&written).expect("written");
    let record: Value = serde_json::from_slice(&contents(&bytes, 2)[0].1).expect("a record");
    assert!(record["shN"]["count"].as_u64() <= Some(1024));
    let read = activated("a.sog", &bytes).expect("read");
    let mut order: Vec<usize> = (0..3000).collect();
    order.sort_by_cached_key(|&index| morton_code(written.positions[index]));
    let mut sorted = ActivatedGaussians::default();
    omnilife_engine::gaussians::subset::gather(&written, &order, &mut sorted);
    let apart = apart(&sorted, &read);
    assert!(
        apart.place < 0.01 && apart.degrees < 1.2 && apart.linear < 0.02 && apart.rest < 0.02,
        "{apart:?}"
    );
}

/// Reads a record on disk with its images.
fn read_folder(folder: &Path) -> Result<ActivatedGaussians, String> {
    let unchanged = Similarity::new([0.0; 3], 1.0);
    let path = folder.join(RECORD_FILE);
    let mut invalid = InvalidGaussians::default();
    let table = exchange::read(&path, &Placement::WORLD, &unchanged, &mut invalid);
    let mut gaussians = ActivatedGaussians::default();
    let table = table.map_err(|error| error.to_string())?;
    omnilife_engine::gaussians::static_gaussians::activate(&table, &mut gaussians);
    Ok(gaussians)
}

#[test]
fn training_with_anti_aliasing_is_told_from_that_without() {
    let bytes = write(&varied(20, 3)).expect("written");
    let flagged = with_record(&bytes, |record| record["antialias"] = json!(true));
    for (bytes, expected) in [(bytes, false), (flagged, true)] {
        let mut invalid = InvalidGaussians::default();
        let table = read(Path::new("a.sog"), &bytes, &mut invalid);
        assert!(table.is_ok_and(|table| table.len() == 20));
        assert_eq!(invalid.is_antialiased, expected);
    }
}

#[test]
fn folders_are_read_by_their_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = write(&varied(20, 3)).expect("written");
    for (name, content) in contents(&bytes, 3) {
        fs::write(folder.path().join(name), content).expect("written");
    }
    let read = read_folder(folder.path()).expect("read");
    assert_eq!(read, activated("a.sog", &bytes).expect("read"));
    fs::remove_file(folder.path().join("quats.webp")).expect("removed");
    let message = read_folder(folder.path()).map(drop).expect_err("refused");
    assert!(
        message.contains("names quats.webp: ") && !message.contains('\n'),
        "{message}"
    );
    let record = with_record(&bytes, |record| {
        record["quats"]["files"] = json!(["../quats.webp"]);
    });
    fs::write(folder.path().join(RECORD_FILE), &contents(&record, 3)[0].1).expect("written");
    let message = read_folder(folder.path()).map(drop).expect_err("refused");
    assert!(
        message.contains("which must be a file beside it"),
        "{message}"
    );
}

#[test]
fn compressed_archives_with_comments_are_read() {
    let bytes = write(&varied(9, 1)).expect("written");
    let expected = activated("a.sog", &bytes).expect("read");
    let (mut archive, mut directory) = (Vec::<u8>::new(), Vec::<u8>::new());
    let files = contents(&bytes, 1);
    for (name, content) in &files {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(content).expect("compressed");
        let packed = encoder.finish().expect("compressed");
        let mut crc = Crc::new();
        crc.update(content);
        let at = archive.len() as u32;
        // With sizes behind the content, as streaming writers leave them out of the header.
        archive.extend(b"PK\x03\x04\x14\0\x08\0\x08\0\0\0\0\0");
        archive.extend([0; 12]);
        archive.extend([(name.len() as u16).to_le_bytes(), [3, 0]].concat());
        archive.extend(name.as_bytes());
        archive.extend(b"abc");
        archive.extend(&packed);
        directory.extend(b"PK\x01\x02\x14\0\x14\0\x08\0\x08\0\0\0\0\0");
        directory.extend(crc.sum().to_le_bytes());
        directory.extend((packed.len() as u32).to_le_bytes());
        directory.extend((content.len() as u32).to_le_bytes());
        directory.extend((name.len() as u16).to_le_bytes());
        directory.extend([2, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        directory.extend(at.to_le_bytes());
        directory.extend(name.as_bytes());
        directory.extend(b"dee");
    }
    let (at, size) = (archive.len() as u32, directory.len() as u32);
    archive.extend(directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend([(files.len() as u16).to_le_bytes(); 2].concat());
    archive.extend(size.to_le_bytes());
    archive.extend(at.to_le_bytes());
    archive.extend([2, 0]);
    archive.extend(b"hi");
    assert_eq!(activated("a.sog", &archive).expect("read"), expected);
}

#[test]
fn what_is_no_sog_is_refused_by_name() {
    let bytes = write(&varied(5, 3)).expect("written");
    let changed = |change: &dyn Fn(&mut Value)| with_record(&bytes, change);
    let full = vec![[255; 4]; 16];
    let mut flipped = bytes.clone();
    // Within the record, the first file.
    flipped[60] ^= 1;
    for (bytes, expected) in [
        (b"glTF".to_vec(), "is not a ZIP archive"),
        (flipped, "has another meta.json than its checksum says"),
        (bundled(&[]).expect("bundled"), "has no meta.json"),
        (
            bundled(&[(RECORD_FILE, b"{".to_vec())]).expect("bundled"),
            "has a malformed record",
        ),
        (
            bundled(&contents(&bytes, 3)[..4]).expect("bundled"),
            "has no shN_centroids.webp",
        ),
        (
            changed(&|record| record["version"] = json!(3)),
            "version 3, and 2 is read",
        ),
        (
            changed(&|record| record["version"] = Value::Null),
            "version 1, and 2 is read",
        ),
        (
            changed(&|record| record["count"] = json!(0)),
            "holds no Gaussians",
        ),
        (
            changed(&|record| record["count"] = json!(17)),
            "does not fit to 17 values",
        ),
        (
            changed(&|record| record["shN"]["bands"] = json!(4)),
            "degree 4",
        ),
        (
            changed(&|record| record["shN"]["bands"] = json!(2)),
            "does not fit to",
        ),
        (
            changed(&|record| record["shN"]["count"] = json!(1)),
            "has no harmonics for Gaussian",
        ),
        (
            changed(&|record| record["scales"]["codebook"] = json!([])),
            "has no size for Gaussian 0",
        ),
        (
            changed(&|record| record["quats"]["files"] = json!(["meta.json"])),
            "meta.json: cannot be decoded",
        ),
        (
            with_image(&bytes, "quats.webp", &[[0; 4]; 16], [4, 4]),
            "has no rotation for Gaussian 0",
        ),
        (
            with_image(&bytes, "shN_labels.webp", &full, [4, 4]),
            "has no harmonics for Gaussian 0",
        ),
        (
            with_image(&bytes, "means_u.webp", &[[0; 4]; 4], [4, 1]),
            "means_u.webp: has 4x1 pixels",
        ),
    ] {
        let message = activated("a.sog", &bytes).map(drop).expect_err(expected);
        assert!(message.contains(expected), "{message}, not {expected}");
        assert!(message.starts_with("a.sog") && !message.contains('\n'));
    }
    let message = activated(
        "a.sog",
        &changed(&|record| record["count"] = json!(u64::MAX)),
    );
    let message = message.map(drop).expect_err("refused");
    assert!(!message.contains('\n'), "{message}");
}

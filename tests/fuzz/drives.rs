//! Readers of drives, on the street in the repository in both layouts. Images stay as they are.

use std::{fs, path::Path};

use omnilife_curate::exchange::{self, ImportRequest, MaskMeaning};
use omnilife_schemas::store;

use crate::{
    folders::below,
    targets::{Input, Reader::Folder, Target},
};

/// Readers of drives.
pub(crate) const DRIVES: &[Target] = &[
    Target {
        id: "kitti-tracking",
        words: &[
            "nan",
            "-1 ",
            "1e308",
            "P2:",
            "R0_rect:",
            "Tr_velo_cam",
            "DontCare",
            "Car",
            "\n",
        ],
        cost: 10,
        seeds: |folder| seeds(folder, "kitti"),
        reader: Folder(|input, _| import(input, "kitti-tracking")),
    },
    Target {
        id: "nuscenes",
        words: &[
            "null",
            "[]",
            "1e999",
            "\"\"",
            "../",
            "\"token\":",
            "\"sample-0\"",
            "4294967295",
            "-9223372036854775808",
        ],
        cost: 10,
        seeds: |folder| seeds(folder, "nuscenes"),
        reader: Folder(|input, _| import(input, "nuscenes")),
    },
    Target {
        id: "waymo",
        words: &[
            "PAR1",
            "[LiDARComponent]",
            "key.camera_name",
            "\0\0\0\0",
            "\u{7f}",
        ],
        cost: 10,
        seeds: |folder| seeds(folder, "waymo"),
        reader: Folder(|input, _| import(input, "waymo")),
    },
];

/// Copies a layout to `in`; returns its files but images.
fn seeds(folder: &Path, layout: &str) -> Vec<String> {
    let street = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/drive");
    let mut found = Vec::new();
    for file in below(&street.join(layout)) {
        let to = folder.join("in").join(&file);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(street.join(layout).join(&file), to).unwrap();
        let is_image = file
            .extension()
            .is_some_and(|kind| kind == "png" || kind == "jpg");
        if !is_image {
            found.push(format!("in/{}", file.display()));
        }
    }
    found.sort();
    found
}

fn import(input: &Input, format: &str) {
    let out = input.folder.join("out");
    drop(exchange::import(&ImportRequest {
        folder: &input.folder.join("in"),
        format,
        id: "a",
        frames_per_second: None,
        masks: MaskMeaning::Moving,
        out: &out,
    }));
    store::remove(&out).unwrap();
}

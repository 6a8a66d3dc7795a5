//! Readers of single files, and the valid files that changes start from.

use std::{
    fs,
    path::{Path, PathBuf},
};

use Reader::{Bytes, Folder};
use omnilife_bench::external::manifest::Manifest;
use omnilife_curate::criteria;
use omnilife_reconstruct::formats::{
    exchange, in_time, ply,
    splat::{self, Placement},
};
use omnilife_schemas::{
    RgbImage,
    frame_scores::FrameScores,
    image_file::ImageFile,
    npy,
    object_scores::ObjectScores,
    points::PointCloud,
    records::{InvalidGaussians, Scene, check_file},
    rgb::Mask,
    store,
    tracked_regions::TrackedRegions,
};
use omnilife_sweep::slurm;

use crate::samples::{
    PALETTE_MASK, cloud, gaussians, names, spherical_mp4, unchanged, write_gaussians_in_time,
    write_scene, write_splat, write_splat_formats, write_tracks,
};

/// File that a reader accepts.
pub(crate) struct Seed {
    /// Its name, relative to the folder.
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
}

/// Folder with the seeds, one of them changed.
pub(crate) struct Input {
    pub(crate) folder: PathBuf,
    pub(crate) seeds: Vec<Seed>,
    /// Number of changed files so far.
    pub(crate) files_read: u64,
}

impl Input {
    /// Reads the seeds of a folder by their names.
    pub(crate) fn new(folder: &Path, names: Vec<String>) -> Self {
        let seed = |name: String| Seed {
            bytes: fs::read(folder.join(&name)).unwrap(),
            name,
        };
        Self {
            folder: folder.to_owned(),
            seeds: names.into_iter().map(seed).collect(),
            files_read: 0,
        }
    }

    pub(crate) fn path(&self, seed: &Seed) -> PathBuf {
        self.folder.join(&seed.name)
    }
}

/// Reader with its seeds.
pub(crate) struct Target {
    pub(crate) id: &'static str,
    /// Words of its format.
    pub(crate) words: &'static [&'static str],
    /// Factor by which it takes longer than others.
    pub(crate) cost: u64,
    /// Fills a folder with files that the reader accepts, and returns the names of those to change.
    pub(crate) seeds: fn(&Path) -> Vec<String>,
    /// Reads the changed file; the result is ignored.
    pub(crate) reader: Reader,
}

/// Reader of a changed file.
#[derive(Clone, Copy)]
pub(crate) enum Reader {
    /// Reads bytes; the seed's name gives their kind.
    Bytes(fn(&Seed, &[u8])),
    /// Reads a folder.
    Folder(fn(&Input, &Seed)),
}

/// Readers of single files.
pub(crate) const FILES: &[Target] = &[
    Target {
        id: "npy",
        words: &["'descr'", "'<f4'", "'<f8'", "(3, 4)", "True", "\n"],
        cost: 1,
        seeds: |folder| {
            let values: Vec<f32> = (0..12_u8).map(f32::from).collect();
            npy::write_f32(&folder.join("a.npy"), &[3, 4], &values).unwrap();
            names(&["a.npy"])
        },
        reader: Bytes(|_, bytes| drop(npy::from_bytes(bytes))),
    },
    Target {
        id: "points",
        words: PLY_WORDS,
        cost: 1,
        seeds: |folder| {
            cloud().write_ply(&folder.join("a.ply")).unwrap();
            let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                        property float z\nend_header\n1 2 3\n";
            fs::write(folder.join("b.ply"), text).unwrap();
            names(&["a.ply", "b.ply"])
        },
        reader: Bytes(|_, bytes| drop(PointCloud::from_ply(bytes))),
    },
    Target {
        id: "gaussians",
        words: PLY_WORDS,
        cost: 1,
        seeds: |folder| {
            fs::write(folder.join("a.ply"), gaussians()).unwrap();
            names(&["a.ply"])
        },
        reader: Folder(|input, seed| {
            let mut invalid = InvalidGaussians::default();
            drop(ply::read(&input.path(seed), &unchanged(), &mut invalid));
        }),
    },
    Target {
        id: "frame-scores",
        words: &["view", "input", "novel", ",", "\"", "\n", "inf"],
        cost: 1,
        seeds: |folder| {
            let text = "view,frame,time_seconds,psnr,ssim\ninput,0,0,31.25,0.91\nnovel,5,0.5,,\n";
            fs::write(folder.join("frames.csv"), text).unwrap();
            names(&["frames.csv"])
        },
        reader: Bytes(|_, bytes| drop(FrameScores::from_bytes(bytes))),
    },
    Target {
        id: "object-scores",
        words: &["view", "object", "input", "novel", ",", "\"", "\n", "inf"],
        cost: 1,
        seeds: |folder| {
            let text = "view,frame,object,psnr-object\ninput,0,car,31.25\nnovel,5,\"a,b\",\n";
            fs::write(folder.join("objects.csv"), text).unwrap();
            names(&["objects.csv"])
        },
        reader: Bytes(|_, bytes| drop(ObjectScores::from_bytes(bytes))),
    },
    Target {
        id: "image",
        words: &["IHDR", "IDAT", "PLTE", "tRNS", "eXIf", "IEND"],
        cost: 2,
        seeds: |folder| {
            RgbImage::black(16, 8)
                .write_png(&folder.join("a.png"))
                .unwrap();
            fs::write(folder.join("b.png"), PALETTE_MASK).unwrap();
            names(&["a.png", "b.png"])
        },
        reader: Folder(|input, seed| {
            let path = input.path(seed);
            drop(ImageFile::open(&path).and_then(ImageFile::decode_shown));
            drop(ImageFile::open(&path).and_then(ImageFile::decode_plain));
            drop(Mask::read(&path));
        }),
    },
    Target {
        id: "records",
        words: &[
            "null",
            "[]",
            "{}",
            "\"\"",
            "true",
            "\"schema\":",
            "omnilife/scene/1",
        ],
        cost: 1,
        seeds: |folder| {
            write_scene(folder);
            let poses = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/street/poses.json");
            fs::copy(poses, folder.join("poses.json")).unwrap();
            names(&["scene.json", "poses.json"])
        },
        reader: Folder(|input, seed| drop(check_file(&input.path(seed)))),
    },
    Target {
        id: "tracks",
        words: &[
            "null",
            "[]",
            "-1",
            "1e308",
            "4294967295",
            "\"degree\":3",
            "\"knots\":",
        ],
        cost: 1,
        seeds: |folder| {
            write_scene(folder);
            write_tracks(folder);
            names(&["tracks.json"])
        },
        reader: Folder(|input, _| {
            let scene: Result<Scene, _> = store::read_record(&input.folder.join("scene.json"));
            let scene = scene.unwrap();
            if let Ok(Some(regions)) = TrackedRegions::find(&scene, &input.folder) {
                for frame in &scene.frames {
                    drop(regions.mask(&scene.camera, frame));
                }
            }
        }),
    },
    Target {
        id: "method",
        words: &[
            "[render]",
            "[train]",
            "{work}",
            "{frame:06}",
            "{{",
            "}}",
            "command = [",
            "= true",
        ],
        cost: 1,
        seeds: |folder| {
            let text = "id = \"m\"\ntime_limit_seconds = 60\n[render]\ncommand = [\"r\", \"{scene}\"]\n\
                        [predictions]\nnovel = \"{work}/{frame:06}.png\"\n";
            fs::write(folder.join("method.toml"), text).unwrap();
            names(&["method.toml"])
        },
        reader: Bytes(|seed, bytes| drop(Manifest::from_bytes(Path::new(&seed.name), bytes))),
    },
    Target {
        id: "criteria",
        words: &["[", "]", "=", "true", "longer_than_seconds", "[thresholds]"],
        cost: 1,
        seeds: |folder| {
            let text = "name = \"own\"\n[thresholds]\nleast_frames_per_second = 24.0\nlonger_than_seconds = 10.0\n";
            fs::write(folder.join("own.toml"), text).unwrap();
            names(&["own.toml"])
        },
        reader: Folder(|input, seed| {
            let path = input.path(seed);
            drop(criteria::criteria(&path.display().to_string(), &path));
        }),
    },
    Target {
        id: "splat",
        words: &[],
        cost: 1,
        seeds: write_splat,
        reader: Bytes(|seed, bytes| {
            drop(splat::from_bytes(
                Path::new(&seed.name),
                bytes,
                &Placement::WORLD,
                &unchanged(),
                &mut InvalidGaussians::default(),
            ));
        }),
    },
    Target {
        id: "splat-formats",
        words: SPLAT_FORMAT_WORDS,
        cost: 1,
        seeds: write_splat_formats,
        reader: Bytes(|seed, bytes| {
            drop(exchange::from_bytes(
                Path::new(&seed.name),
                bytes,
                &Placement::WORLD,
                &unchanged(),
                &mut InvalidGaussians::default(),
            ));
        }),
    },
    Target {
        id: "gaussians-in-time",
        words: &[
            "GAUSTIME",
            "\"kind\": \"",
            "periodic",
            "rigid",
            "exp",
            "u24",
            "\"count\": ",
            "1e999",
        ],
        cost: 1,
        seeds: write_gaussians_in_time,
        reader: Bytes(|seed, bytes| {
            let invalid = &mut InvalidGaussians::default();
            drop(in_time::from_bytes(
                Path::new(&seed.name),
                bytes,
                &unchanged(),
                invalid,
            ));
        }),
    },
    Target {
        id: "slurm",
        words: &["MaxArraySize", "=", "_", ";", "[", "]", "N/A", "\n"],
        cost: 1,
        seeds: |folder| {
            for (name, text) in [
                (
                    "config.txt",
                    "AccountingStorageType = none\nMaxArraySize            = 1001\n",
                ),
                ("queue.txt", "12_0\n12_1\n13_[2-4]\n"),
                ("job.txt", "1234;cluster\n"),
            ] {
                fs::write(folder.join(name), text).unwrap();
            }
            names(&["config.txt", "queue.txt", "job.txt"])
        },
        reader: Bytes(|_, bytes| {
            let text = String::from_utf8_lossy(bytes);
            let _ = slurm::answers::max_array_size(&text);
            let _ = slurm::answers::queued_tasks(&text);
            let _ = slurm::answers::job_id(&text);
        }),
    },
    Target {
        id: "mp4-boxes",
        words: MP4_WORDS,
        cost: 1,
        seeds: |folder| {
            fs::write(folder.join("a.mp4"), spherical_mp4()).unwrap();
            names(&["a.mp4"])
        },
        reader: Bytes(|_, bytes| drop(omnilife_video::count_statements(bytes, 1))),
    },
    Target {
        id: "mp4",
        words: MP4_WORDS,
        cost: 10,
        seeds: |folder| {
            let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/street/street.mp4");
            fs::copy(sample, folder.join("a.mp4")).unwrap();
            names(&["a.mp4"])
        },
        reader: Folder(|input, seed| drop(omnilife_video::probe(&input.path(seed)))),
    },
];

const SPLAT_FORMAT_WORDS: &[&str] = &["NGSP", "element sh 6", "uchar", "5121", "\"scale\":"];

const MP4_WORDS: &[&str] = &[
    "moov", "trak", "uuid", "st3d", "sv3d", "proj", "equi", "stsd", "tkhd", "colr", "mdat",
];

const PLY_WORDS: &[&str] = &[
    "element vertex ",
    "element face ",
    "property float x\n",
    "property list uchar int i\n",
    "double",
    "uchar",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "end_header\n",
];

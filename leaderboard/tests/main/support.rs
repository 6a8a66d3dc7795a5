//! Results for tests.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_leaderboard::LeaderboardRequest;
use omnilife_schemas::{
    records::{Direction, ResultRecord, Summary},
    store,
};

/// Hash of the protocol of [`result`].
pub(crate) const HASH: &str = "a34df006b285d6dd90c37a7a75910de4bca28811a4d187874bfe778ee099e3bd";

/// A metric that is better when higher.
pub(crate) fn summary(mean: f64, views: u32) -> Summary {
    Summary {
        mean,
        views,
        direction: Some(Direction::HigherIsBetter),
        standard_deviation: None,
        undefined_views: 0,
    }
}

/// A result whose novel views score `psnr` and its input views 3 dB more.
pub(crate) fn result(scene: &str, method: &str, psnr: f64, ssim: f64) -> ResultRecord {
    ResultRecord {
        scene_sha256: store::sha256_bytes(scene.as_bytes()),
        protocol: "per-scene/1".to_owned(),
        protocol_hash: HASH.to_owned(),
        scored_size: [512, 256],
        input_views: [
            ("psnr".to_owned(), summary(psnr + 3.0, 48)),
            ("ssim".to_owned(), summary(ssim + 0.05, 48)),
        ]
        .into(),
        novel_views: [
            ("psnr".to_owned(), summary(psnr, 12)),
            ("ssim".to_owned(), summary(ssim, 12)),
        ]
        .into(),
        training_seconds: Some(61.25),
        primitives: Some(123_456),
        iterations: Some(3000),
        ..ResultRecord::new(method, scene)
    }
}

/// Writes a result where scoring would, and returns its folder.
pub(crate) fn write(results: &Path, result: &ResultRecord) -> PathBuf {
    let seed = result.seed.unwrap_or(0);
    let method = store::sha256_bytes(result.method.as_bytes());
    let name = format!("{}/{}/{seed}/score", result.scene, &method[..8]);
    let folder = results.join(name);
    fs::create_dir_all(&folder).unwrap();
    store::write_record(&folder.join("result.json"), result).unwrap();
    folder
}

/// A request for tables and site.
pub(crate) fn request(results: &Path, out: &Path) -> LeaderboardRequest {
    LeaderboardRequest {
        results: results.to_owned(),
        out: out.to_owned(),
        dataset: None,
        page: None,
        site: true,
        views: 2,
        project: None,
        descriptions: Vec::new(),
    }
}

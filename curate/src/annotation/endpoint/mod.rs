//! Captions by any endpoint that speaks the chat-completions protocol: vLLM, Ollama, llama.cpp, hosted
//! models.
//!
//! Language models know photographs, so a panorama is shown as four perspective views around the horizon (`views`).
//! Answers are cached under the hash of their request (`kept`): an interrupted or repeated run sends no request twice.
//! Network access is in `client`.

pub mod client;
mod kept;
mod views;

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{CaptionAnswer, Sequence},
};

use super::TagRow;
use crate::error::CurateError;
use client::{ChatClient, ChatRequest};
pub use client::{Endpoint, Key, RetryPolicy};

/// Prompt about the views of a sequence.
pub const PROMPT: &str = "These images are frames of one 360-degree video in order of time. Each moment is \
shown by four views around the camera: front, right, back, left. Describe the video in two to four plain \
sentences: the place, what moves, how the camera moves, light and weather. Say only what can be seen. Answer \
with the description alone.";

/// A model behind an endpoint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaptionEndpoint {
    /// Address.
    pub endpoint: Endpoint,
    /// Name of the model there.
    pub model: String,
    /// Secret sent with requests; never written anywhere.
    pub key: Option<Key>,
    /// Time limits and retries.
    pub patience: RetryPolicy,
}

impl CaptionEndpoint {
    /// Captions a sequence, or takes the cached answer from the dataset's folder. The author is the model.
    ///
    /// # Errors
    /// [`CurateError::Input`] when the endpoint cannot be reached, refuses, or answers something else
    /// than a caption; the other errors when frames cannot be read or the answer cannot be kept.
    pub(super) fn run(
        &self,
        dataset: &Path,
        folder: &Path,
        sequence: &Sequence,
        progress: &dyn Progress,
    ) -> Result<TagRow, CurateError> {
        progress.begin(&format!("captioning {}", sequence.id), None);
        let caption = self.caption(dataset, folder, sequence, progress);
        progress.end();
        Ok(TagRow {
            sequence: sequence.id.clone(),
            author: self.model.clone(),
            scene: None,
            action: None,
            traversal: None,
            caption: Some(caption?),
        })
    }

    fn caption(
        &self,
        dataset: &Path,
        folder: &Path,
        sequence: &Sequence,
        progress: &dyn Progress,
    ) -> Result<String, CurateError> {
        let images = views::of_sequence(folder, sequence)?;
        let request = ChatRequest::new(&self.model, PROMPT, &images);
        let file = kept::file(dataset, &self.endpoint, &self.model, PROMPT, &images);
        if let Some(answer) = kept::read(&file)? {
            progress.note(&format!("{}: caption kept, not asked again", sequence.id));
            return Ok(answer.caption);
        }
        let failed = |reason: String| {
            CurateError::input(
                Path::new(&self.endpoint.to_string()),
                format!("captioning {} by {}: {reason}", sequence.id, self.model),
            )
        };
        let client =
            ChatClient::new(&self.endpoint, self.key.as_ref(), self.patience).map_err(failed)?;
        let caption = client.ask(&request, progress).map_err(failed)?;
        let answer = CaptionAnswer {
            endpoint: self.endpoint.to_string(),
            model: self.model.clone(),
            prompt: PROMPT.to_owned(),
            images: images.len() as u64,
            caption,
        };
        kept::write(&file, &answer)?;
        Ok(answer.caption)
    }
}

//! Descriptions of the program's own methods, for their pages: paper, components, options.

/// Description of a method by the program that has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MethodDescription {
    /// Name in the tables.
    pub method: String,
    /// Full name.
    pub title: String,
    /// Publication.
    pub source: String,
    /// The implementation, with its departures from the publication. Its first sentence stands alone.
    pub text: String,
    /// Backends that compute it.
    pub backends: Vec<String>,
    /// Components that it has by default.
    pub components: Vec<String>,
    /// Components that it has where they are named.
    pub on_request: Vec<String>,
    /// Options beside those of all methods.
    pub options: Vec<OptionDescription>,
}

/// Option of a method.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionDescription {
    /// Name on the command line.
    pub name: String,
    /// Effect on the result.
    pub text: String,
    /// Accepted values.
    pub values: String,
    /// Value without a choice.
    pub default: String,
}

impl MethodDescription {
    /// Returns the first sentence of the text, and the rest.
    pub(crate) fn sentence_and_rest(&self) -> (&str, &str) {
        let end = self.text.find(". ").map_or(self.text.len(), |at| at + 1);
        let (sentence, rest) = self.text.split_at(end);
        (sentence, rest.trim_start())
    }
}

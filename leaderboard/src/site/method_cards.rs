//! Authors and machines of submitted methods.

use std::collections::BTreeMap;

use maud::{Markup, html};
use omnilife_schemas::records::{MethodCard, Verification};

use super::links::is_web_address;

/// Counts of verified results, by method.
type Verifications = BTreeMap<String, Verification>;

/// Returns one block per card; nothing without submissions.
pub(super) fn render(cards: &[MethodCard], verifications: &Verifications) -> Markup {
    html! {
        @if !cards.is_empty() {
            h2 #methods { "Methods that were handed in" }
            p { "As their authors describe them." }
            @for card in cards { (block(card, verifications.get(&card.method), false)) }
        }
    }
}

pub(super) fn block(card: &MethodCard, verification: Option<&Verification>, open: bool) -> Markup {
    html! {
        details.card open[open] {
            summary { (card.method) ": " (card.title) }
            @if let Some(verification) = verification {
                p { span.badge { (verification.in_words()) } }
            }
            dl {
                dt { "Authors" }
                dd { (card.authors.join(", ")) }
                dt { "Code" }
                dd { (code(card.code.as_deref())) }
                dt { "Licence" }
                dd { (card.licence.as_deref().unwrap_or("not stated")) }
                dt { "Hardware" }
                dd { (card.hardware) }
                @if let Some(notes) = &card.notes {
                    dt { "Notes" }
                    dd { (notes) }
                }
            }
        }
    }
}

/// Returns a link for an address of the web; other schemes could run scripts.
pub(super) fn code(address: Option<&str>) -> Markup {
    match address {
        None => html! { "not public" },
        Some(address) if is_web_address(address) => {
            html! { a href=(address) rel="noopener noreferrer" { (address) } }
        }
        Some(other) => html! { (other) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cards_are_text_and_link_to_the_web_alone() {
        let card = |code: &str| MethodCard {
            method: "<script>alert(1)</script>".to_owned(),
            title: "A method".to_owned(),
            authors: vec!["A. Author".to_owned(), "B. Author".to_owned()],
            code: Some(code.to_owned()),
            licence: None,
            hardware: "one processor".to_owned(),
            training: None,
            iterations: None,
            notes: None,
        };
        let cards = [
            card("https://example.org/code"),
            card("javascript:alert(1)"),
        ];
        let page = render(&cards, &Verifications::new());
        let page = page.into_string();
        assert!(page.contains("A. Author, B. Author") && page.contains("not stated"));
        assert!(
            page.contains("&lt;script&gt;") && !page.contains("<script>"),
            "{page}"
        );
        assert_eq!(page.matches("href=").count(), 1, "{page}");
        assert_eq!(render(&[], &Verifications::new()).into_string(), "");
    }
}

//! Licences of datasets: the texts that name one, and its identifier on dataset hubs.
//!
//! Identifiers are those of the SPDX licence list (<https://spdx.org/licenses/>) for data, documents and code. Other
//! licences have a `LicenseRef-` identifier (SPDX 2.3, annex D) or the address of their text. The hub is that of Hugging
//! Face (<https://huggingface.co/docs/hub/repositories-licenses>).

/// SPDX identifier of a licence, and the hub's identifier where it has one.
type Licence = (&'static str, Option<&'static str>);

/// Licences that datasets use.
const LICENCES: &[Licence] = &[
    ("AGPL-3.0-only", Some("agpl-3.0")),
    ("AGPL-3.0-or-later", Some("agpl-3.0")),
    ("Apache-2.0", Some("apache-2.0")),
    ("BSD-2-Clause", Some("bsd-2-clause")),
    ("BSD-3-Clause", Some("bsd-3-clause")),
    ("C-UDA-1.0", Some("c-uda")),
    ("CC-BY-2.0", Some("cc-by-2.0")),
    ("CC-BY-2.5", Some("cc-by-2.5")),
    ("CC-BY-3.0", Some("cc-by-3.0")),
    ("CC-BY-4.0", Some("cc-by-4.0")),
    ("CC-BY-NC-2.0", Some("cc-by-nc-2.0")),
    ("CC-BY-NC-3.0", Some("cc-by-nc-3.0")),
    ("CC-BY-NC-4.0", Some("cc-by-nc-4.0")),
    ("CC-BY-NC-ND-3.0", Some("cc-by-nc-nd-3.0")),
    ("CC-BY-NC-ND-4.0", Some("cc-by-nc-nd-4.0")),
    ("CC-BY-NC-SA-2.0", Some("cc-by-nc-sa-2.0")),
    ("CC-BY-NC-SA-3.0", Some("cc-by-nc-sa-3.0")),
    ("CC-BY-NC-SA-4.0", Some("cc-by-nc-sa-4.0")),
    ("CC-BY-ND-3.0", None),
    ("CC-BY-ND-4.0", Some("cc-by-nd-4.0")),
    ("CC-BY-SA-2.0", None),
    ("CC-BY-SA-3.0", Some("cc-by-sa-3.0")),
    ("CC-BY-SA-4.0", Some("cc-by-sa-4.0")),
    ("CC0-1.0", Some("cc0-1.0")),
    ("CDLA-Permissive-1.0", Some("cdla-permissive-1.0")),
    ("CDLA-Permissive-2.0", Some("cdla-permissive-2.0")),
    ("CDLA-Sharing-1.0", Some("cdla-sharing-1.0")),
    ("DL-DE-BY-2.0", None),
    ("DL-DE-ZERO-2.0", None),
    ("etalab-2.0", Some("etalab-2.0")),
    ("GFDL-1.3-only", Some("gfdl")),
    ("GFDL-1.3-or-later", Some("gfdl")),
    ("GPL-2.0-only", Some("gpl-2.0")),
    ("GPL-2.0-or-later", Some("gpl-2.0")),
    ("GPL-3.0-only", Some("gpl-3.0")),
    ("GPL-3.0-or-later", Some("gpl-3.0")),
    ("ISC", Some("isc")),
    ("LGPL-3.0-only", Some("lgpl-3.0")),
    ("LGPL-3.0-or-later", Some("lgpl-3.0")),
    ("MIT", Some("mit")),
    ("MPL-2.0", Some("mpl-2.0")),
    ("NLOD-2.0", None),
    ("O-UDA-1.0", None),
    ("ODbL-1.0", Some("odbl")),
    ("ODC-By-1.0", Some("odc-by")),
    ("OGL-Canada-2.0", None),
    ("OGL-UK-3.0", None),
    ("PDDL-1.0", Some("pddl")),
    ("Unlicense", Some("unlicense")),
];

/// Prefix of identifiers of licences that are not on the SPDX list.
const OWN_PREFIX: &str = "LicenseRef-";

/// Returns a licence in the spelling of the SPDX list, by its identifier there or on the hub, whose letter case does not
/// matter; `LicenseRef-` identifiers and http addresses as they are. An identifier of the hub that covers several
/// licences stands for the first one.
///
/// # Errors
/// One line with the accepted forms, for any other text.
pub fn licence(text: &str) -> Result<String, String> {
    let text = text.trim();
    if let Some((id, _)) = known(text) {
        return Ok((*id).to_owned());
    }
    let is_own = text.strip_prefix(OWN_PREFIX).is_some_and(|name| {
        let is_allowed = |letter: char| letter.is_ascii_alphanumeric() || "-.".contains(letter);
        !name.is_empty() && name.chars().all(is_allowed)
    });
    if is_own || is_address(text) {
        return Ok(text.to_owned());
    }
    let ids: Vec<&str> = LICENCES.iter().map(|(id, _)| *id).collect();
    Err(format!(
        "must be one of the SPDX identifiers {}, {OWN_PREFIX}NAME, or the http address of a licence, got {text:?}",
        ids.join(", ")
    ))
}

/// Returns the identifier of a licence on the hub; `None` for licences that the hub calls `other`.
pub(super) fn hub_identifier(text: &str) -> Option<&'static str> {
    known(text).and_then(|(_, hub)| *hub)
}

/// Returns whether a licence is given by the address of its text.
pub(super) fn is_address(text: &str) -> bool {
    ["https://", "http://"].iter().any(|scheme| {
        text.strip_prefix(scheme)
            .is_some_and(|rest| !rest.is_empty() && !rest.contains(char::is_whitespace))
    })
}

fn known(text: &str) -> Option<&'static Licence> {
    let is_known = |id: &str| id.eq_ignore_ascii_case(text);
    LICENCES
        .iter()
        .find(|(id, hub)| is_known(id) || hub.is_some_and(is_known))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn licences_are_known_own_or_addresses() {
        for (text, expected) in [
            ("cc-by-4.0", "CC-BY-4.0"),
            ("odbl-1.0", "ODbL-1.0"),
            ("odbl", "ODbL-1.0"),
            ("ODC-BY", "ODC-By-1.0"),
            ("pddl", "PDDL-1.0"),
            ("GPL-3.0-or-later", "GPL-3.0-or-later"),
            (" MIT ", "MIT"),
            ("LicenseRef-Lab-1.0", "LicenseRef-Lab-1.0"),
            ("https://example.org/terms", "https://example.org/terms"),
        ] {
            assert_eq!(licence(text), Ok(expected.to_owned()), "{text}");
        }
        for text in [
            "GPLX",
            "",
            "LicenseRef-",
            "LicenseRef-a b",
            "https://",
            "example.org",
        ] {
            let refusal = licence(text).expect_err(text);
            for part in ["CC-BY-4.0", "LicenseRef-NAME"] {
                assert!(refusal.contains(part), "{text}: {refusal}");
            }
        }
    }

    #[test]
    fn every_licence_is_its_own_and_hubs_have_some() {
        for (id, hub) in LICENCES {
            assert_eq!(licence(id).as_deref(), Ok(*id));
            assert_eq!(hub_identifier(id), *hub);
        }
        assert_eq!(hub_identifier("ODbL-1.0"), Some("odbl"));
        assert_eq!(hub_identifier("LicenseRef-Lab-1.0"), None);
    }
}

//! `shellcal licences`: what the program is made of, and under which licences.

use serde_json::json;

use crate::printer::Printer;

/// Package, version and licence (SPDX) in a line each; `cargo xtask licences` writes it.
const NOTICES: &str = include_str!("../../../../assets/licences.tsv");

#[derive(Debug, clap::Args)]
pub(crate) struct LicencesArgs {}

impl LicencesArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let rows: Vec<Vec<String>> =
            NOTICES.lines().map(|line| line.split('\t').map(str::to_owned).collect()).collect();
        let (version, licence) = (env!("CARGO_PKG_VERSION"), env!("CARGO_PKG_LICENSE"));
        let package =
            |row: &Vec<String>| json!({ "package": row[0], "version": row[1], "licence": row[2] });
        let document = json!({
            "program": { "package": "shellcal", "version": version, "licence": licence },
            "made_of": rows.iter().map(package).collect::<Vec<_>>(),
        });
        printer.finish(&document, |printer| {
            printer.line(format!("shellcal {version}: {licence}, at your choice; made of"))?;
            printer.table(&["package", "version", "licence"], rows)?;
            printer.line(
                "The texts are in the packages of a release and, for each package, at \
                 https://crates.io/crates/PACKAGE/VERSION.",
            )
        })
    }
}

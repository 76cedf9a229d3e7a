"""Style sheets and scripts of the pages; `proofmass.report.page.write_static` copies them."""

// The page of a model without a sidecar: buttons that copy.
"use strict";

for (const button of findAll("[data-copy]")) {
  button.addEventListener("click", () => copyText(button.dataset.copy, button));
}

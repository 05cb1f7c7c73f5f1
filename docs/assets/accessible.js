// Names the theme's search dialog, and lets the keyboard scroll wide tables.
"use strict";
document.querySelector(".md-search[role=dialog]")?.setAttribute("aria-label", "Search");
new MutationObserver(() => {
  document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])").forEach((box) => {
    box.tabIndex = 0;
  });
}).observe(document.body, { childList: true, subtree: true });

//! Figures and self-contained pages in one style.

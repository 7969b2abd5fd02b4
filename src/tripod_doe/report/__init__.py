"""Reports: sentences, figures and pages, all made from cubes."""

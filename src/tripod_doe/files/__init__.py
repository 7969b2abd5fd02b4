"""Files: tables that people write, files replaced as a whole, checksums, and files of strangers."""

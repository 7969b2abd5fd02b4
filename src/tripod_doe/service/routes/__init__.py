"""Routes of the HTTP interface, a module for each kind of resource."""

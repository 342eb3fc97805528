"""An animated asset in, a text of tools out: a segment across each place that its clips compress most."""

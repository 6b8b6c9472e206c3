"""The command `impact-gym`, and the programs that use `agents`, such as the report and the studies."""

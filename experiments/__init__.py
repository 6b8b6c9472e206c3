"""The command `impact-gym`, and programs that use `agents`, such as report and studies."""

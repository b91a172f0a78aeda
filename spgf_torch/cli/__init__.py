"""What all commands share: arguments, Hydra, run folders, sweeps, exit status (`run_command`)."""

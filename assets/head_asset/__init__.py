"""Steps that turn the CC0 MakeHuman head into `shared_model/data/head.npz`."""

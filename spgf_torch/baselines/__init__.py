"""What people would use instead of the descriptor: a network that learns to judge a grasp from the points about it.

`samples` reads what `export format=webdataset` leaves and checks it against objects and trials; `pointnet` is the
network and what it is taught with, in torch alone; `lightning_module` is the LightningModule around it, `fit` trains
it, with checkpoints; `folds` runs the cross-validation of `train`, fold by fold, and keeps what is done; `costs`
measures. The paper has no part in this; the network is that of Qi et al., PointNet (CVPR 2017), small and without
T-nets.
"""

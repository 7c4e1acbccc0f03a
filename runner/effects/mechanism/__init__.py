"""The effects of a mechanism of joints: any MuJoCo model of hinges and slides, with its actuators and sensors."""

"""Recipes: the default, those for built-in and for real recordings, and those of the students' reports."""

from dataclasses import replace

from pilot.data.augment import AugmentConfig
from pilot.data.samples import SampleConfig
from pilot.training.config import TrainingConfig

NO_AUGMENTATION = AugmentConfig(flip=0, rotation=0, brightness=0, shadow=0, crop=0, viewpoint=0)

# For recordings of people. Most use a keyboard, whose pulses are averaged. Views are displaced as far as a car that is
# about to leave the road; they return to the driver's path near in tight bends and far on straights, as people do.
_OF_PEOPLE = SampleConfig(side_correction=0.03, smooth_seconds=0.6)
_WIDE_VIEWS = AugmentConfig(
    viewpoint=0.8, viewpoint_metres=2.0, viewpoint_degrees=14.0, viewpoint_lookahead=20.0, viewpoint_nearest=8.0
)
_DEFAULT = TrainingConfig(samples=_OF_PEOPLE, augment=_WIDE_VIEWS)
# Report 000: side cameras, mirrored copies, six rotated copies of each image, split by single time steps.
_ROTATIONS = SampleConfig(split="moments", flipped_copies=True, rotated_copies=6, rotation_range=45)
_REPORT_000 = TrainingConfig(
    recipe="nvidia-rotations",
    network="nvidia",
    batch_size=128,
    learning_rate=1e-3,
    l2=1e-3,
    patience=3,
    schedule="constant",
    min_delta=1e-5,
    samples=_ROTATIONS,
    augment=NO_AUGMENTATION,
)
# Report 002: centre camera, mirrored copies, 9 of 10 time steps with zero steering dropped, 2 % for validation.
_REPORT_002 = TrainingConfig(
    recipe="lenet-drop-zeros",
    network="lenet",
    batch_size=16,
    epochs=5,
    learning_rate=1e-3,
    l2=0,
    patience=5,
    schedule="constant",
    samples=SampleConfig(
        cameras="center",
        balance="drop-zeros",
        drop_zeros=0.9,
        split="moments",
        validation_share=0.02,
        flipped_copies=True,
    ),
    augment=NO_AUGMENTATION,
)
# Report 004: geometric rule for the side cameras, spikes reduced, random augmentation including height crop.
_REPORT_004 = TrainingConfig(
    recipe="simplenet-spikes",
    network="simplenet",
    batch_size=128,
    epochs=20,
    learning_rate=1e-4,
    l2=0,
    patience=20,
    schedule="constant",
    samples=SampleConfig(side_rule="geometric", balance="spikes", split="moments", validation_share=0.15),
    augment=AugmentConfig(crop=1.0, viewpoint=0),
)
_REPORT_RECIPES: dict[str, TrainingConfig] = {
    "nvidia-rotations": _REPORT_000,
    "nvidia-rotations-no-l2": replace(_REPORT_000, recipe="nvidia-rotations-no-l2", l2=0),
    "lenet5-rotations": replace(_REPORT_000, recipe="lenet5-rotations", network="lenet5"),
    "lenet-drop-zeros": _REPORT_002,
    "nvidia-drop-zeros": replace(_REPORT_002, recipe="nvidia-drop-zeros", network="nvidia"),
    "simplenet-spikes": _REPORT_004,
    "densenet-spikes": replace(
        _REPORT_004, recipe="densenet-spikes", network="densenet", epochs=10, learning_rate=1e-3
    ),
}
# For the built-in simulator's demonstrations. The labels of side cameras and shifted viewpoints return to the path
# like the expert. No mirroring, because the laps cover both directions and keep to the right on two-lane roads. Neither
# random brightness nor shadows: the network standardises the images, and the roads have lights and shadows anyway.
# Random saturation, because the real simulator's colours differ. The labels are free of noise, so that little L2 and
# few epochs with a high learning rate suffice. The last epoch is kept, because the small validation set is noisy.
_BUILT_IN = TrainingConfig(
    recipe="built-in",
    network="pilotnet_standardised",
    epochs=9,
    batch_size=32,
    learning_rate=1.4e-3,
    warm_up=200,
    l2=1e-6,
    select="last",
    samples=SampleConfig(side_rule="pursuit", validation_share=0.1),
    augment=AugmentConfig(flip=0, brightness=0, shadow=0, viewpoint_lookahead=None, saturation=0.25),
)
# The same for networks that see earlier frames or predict what comes later, from whole drives too, which are more rows.
_SEQUENCES = replace(_BUILT_IN, recipe="sequences", network="pilotnet_plan")
# For recordings of people in the Unity simulator, from the weights of models/built_in.pt. People drive anywhere on the
# road, so that networks trained by them alone hardly return to its middle; averaged with the weights of the model that
# did, they do, and agree with people almost as well. Shadows, because the highest graphics setting draws hard ones.
_REAL = replace(
    _BUILT_IN,
    recipe="real",
    epochs=6,
    learning_rate=7e-4,
    start_share=0.25,
    samples=replace(_OF_PEOPLE, validation_share=0.1),
    augment=replace(_WIDE_VIEWS, brightness=0, saturation=0.25),
)
# For a person's own laps on top of a ready-made model: few, so that more of the model is kept.
_FINE_TUNE = replace(_REAL, recipe="fine-tune", start_share=0.7)
# For learning from corrections in the built-in simulator, together with earlier demonstrations. They may be few; then
# three epochs would be too short, and their validation set too small to end the training by its error.
_CORRECTIONS = replace(
    _BUILT_IN, recipe="corrections", epochs=3, min_steps=1200, patience=1000, learning_rate=5e-4, warm_up=50
)
# The same with the expert's corrections, which are as many as the demonstrations: see `pilot.training.improvement`.
IMPROVEMENT = replace(_CORRECTIONS, epochs=2, min_steps=0, samples=replace(_BUILT_IN.samples, correction_weight=1))
RECIPES: dict[str, TrainingConfig] = {
    "default": _DEFAULT,
    "built-in": _BUILT_IN,
    "sequences": _SEQUENCES,
    **_REPORT_RECIPES,
    "real": _REAL,
    "fine-tune": _FINE_TUNE,
    "corrections": _CORRECTIONS,
}

"""List joint types and descriptions of the paper's 34 articulated classes (Table 3)."""

from __future__ import annotations

_CLASSES = {
    "bag_lift": ("prismatic", "a bag that can be lifted off the table by its strap"),
    "bag_move": ("prismatic", "a bag that can be pushed across the table"),
    "bag_swing": ("revolute", "a bag that stands still, with a strap that swings about a hinge"),
    "bottle_cap": ("revolute", "a bottle that stands still, with a cap that turns"),
    "box_move": ("prismatic", "a box that can be pushed across the table"),
    "box_rotate": ("revolute", "a box that stands still, with a hinged lid that opens and closes"),
    "bucket_lift": ("prismatic", "a bucket that can be lifted off the table by its handle"),
    "bucket_move": ("prismatic", "a bucket that can be pushed across the table"),
    "bucket_swing": ("revolute", "a bucket that stands still, with a handle that swings about its hinges"),
    "coffee_machine": ("prismatic", "a coffee machine that stands still, with a button or lid that can be pressed"),
    "dishwasher": ("revolute", "a dishwasher with a hinged door that folds down and up"),
    "door": ("revolute", "a door in a frame, hinged at one side"),
    "drawer": ("prismatic", "a cabinet that stands still, with a drawer that slides out and in"),
    "faucet": ("revolute", "a faucet that stands still, with a handle that turns it on and off"),
    "kitchen_pot": ("prismatic", "a pot that stands still, with a lid that lifts off"),
    "laptop_move": ("prismatic", "a laptop that can be pushed across the table"),
    "laptop_rotate": ("revolute", "a laptop that stands still, with a hinged screen that opens and closes"),
    "microwave": ("revolute", "a microwave oven with a hinged door that opens and closes"),
    "oven": ("revolute", "an oven with a hinged door that folds down and up"),
    "refrigerator": ("revolute", "a refrigerator with a hinged door that opens and closes"),
    "safe_move": ("prismatic", "a safe that can be pushed across the table"),
    "safe_rotate": ("revolute", "a safe with a hinged door that opens and closes"),
    "stapler_move": ("prismatic", "a stapler that can be pushed across the table"),
    "stapler_press": ("revolute", "a stapler that stands still, with an arm that can be pressed down"),
    "suitcase_move": ("prismatic", "a suitcase that can be pushed across the table"),
    "suitcase_rotate": ("revolute", "a suitcase that lies flat, with a hinged lid that opens and closes"),
    "switch": ("revolute", "a wall switch with a rocker that tips on and off"),
    "toaster_move": ("prismatic", "a toaster that can be pushed across the table"),
    "toaster_press": ("prismatic", "a toaster that stands still, with a lever that can be pressed down"),
    "toilet": ("revolute", "a toilet with a hinged lid that opens and closes"),
    "trash_can": ("revolute", "a trash can that stands still, with a hinged lid that opens and closes"),
    "washing_machine": ("revolute", "a washing machine with a hinged door that opens and closes"),
    "window_push": ("prismatic", "a window with a pane that slides sideways in its frame"),
    "window_rotate": ("revolute", "a window with a pane that turns in its frame"),
}
JOINT_TYPES = {name: joint for name, (joint, _) in _CLASSES.items()}
DESCRIPTIONS = {name: text for name, (_, text) in _CLASSES.items()}

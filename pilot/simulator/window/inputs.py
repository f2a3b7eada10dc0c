"""Input from keyboard, mouse and gamepad of a Panda3D window."""

from panda3d.core import (
    ButtonThrower,
    DataGraphTraverser,
    EventQueue,
    GraphicsWindow,
    InputDevice,
    InputDeviceManager,
    ModifierButtons,
    MouseAndKeyboard,
    NodePath,
)

from pilot.simulator.window.controls import Controls, Pad

UP = "-up"


class Inputs:
    """Updates the controls from the input devices of a window."""

    def __init__(self, window: GraphicsWindow, controls: Controls) -> None:
        self._window, self._controls = window, controls
        thrower = ButtonThrower("buttons")
        thrower.set_modifier_buttons(ModifierButtons())  # otherwise "a" is reported as "shift-a" with shift
        self._devices = NodePath("devices")
        self._devices.attach_new_node(MouseAndKeyboard(window, 0, "keyboard")).attach_new_node(thrower)
        self._traverser = DataGraphTraverser()
        self._events = EventQueue.get_global_event_queue()
        self._gamepads = InputDeviceManager.get_global_ptr()

    def poll(self) -> list[str]:
        """Update the controls and return the keys that were pressed since the last call."""
        self._controls.pointer = self._window.get_pointer(0).x / max(self._window.get_x_size(), 1)
        self._controls.pad = self._read_gamepad()
        self._traverser.traverse(self._devices.node())
        pressed = []
        while not self._events.is_queue_empty():
            name = self._events.dequeue_event().name
            if name.endswith(UP):
                self._controls.release(name.removesuffix(UP))
            else:  # includes key repeats and unrelated events; their names are no keys and have no effect
                self._controls.press(name)
                pressed.append(name)
        return pressed

    def _read_gamepad(self) -> Pad | None:
        self._gamepads.update()
        devices = self._gamepads.get_devices(InputDevice.DeviceClass.gamepad)
        if not devices:
            return None
        devices[0].poll()
        axes = (InputDevice.Axis.left_x, InputDevice.Axis.right_trigger, InputDevice.Axis.left_trigger)
        return Pad(*(float(devices[0].find_axis(axis).value) for axis in axes))

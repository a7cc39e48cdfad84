//! What desktops tell windows on X11, by properties.

use crate::harness::Display;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    AtomEnum, CONFIGURE_NOTIFY_EVENT, ConfigureNotifyEvent, ConnectionExt as _, CreateWindowAux, EventMask,
    PropMode, Window, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// A desktop, as far as windows ask it.
pub(crate) struct Desktop {
    connection: RustConnection,
    /// Holds the settings.
    settings: Window,
}

impl Desktop {
    /// Begins to have settings, which windows that open later listen to.
    pub(crate) fn of(display: &Display) -> Desktop {
        let name = display.environment[0].1.to_str().expect("text");
        let (connection, _) = x11rb::connect(Some(name)).expect("a server");
        let settings = connection.generate_id().expect("an id");
        let (root, depth) = (connection.setup().roots[0].root, x11rb::COPY_DEPTH_FROM_PARENT);
        let class = WindowClass::INPUT_ONLY;
        let nothing = CreateWindowAux::new();
        let made = connection.create_window(depth, settings, root, 0, 0, 1, 1, 0, class, 0, &nothing);
        made.expect("sent").check().expect("a window");
        let desktop = Desktop { connection, settings };
        desktop.set_density(1);
        let selection = desktop.atom("_XSETTINGS_S0");
        let owned = desktop.connection.set_selection_owner(settings, selection, x11rb::CURRENT_TIME);
        owned.expect("sent").check().expect("nobody else has it");
        desktop
    }

    fn atom(&self, name: &str) -> u32 {
        let asked = self.connection.intern_atom(false, name.as_bytes()).expect("sent");
        asked.reply().expect("an atom").atom
    }

    /// Screens have so many times the usual density, 96 pixels an inch: a block of settings as XSETTINGS describes it,
    /// of the one called `Xft/DPI`, in 1/1024 of a pixel an inch.
    pub(crate) fn set_density(&self, density: u32) {
        let (name, serial) = ("Xft/DPI", 0_u32);
        // Little-endian, three bytes that mean nothing, serial, number of settings; type (an integer) and a byte.
        let mut block = vec![0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0];
        block.extend(u16::try_from(name.len()).expect("short").to_le_bytes());
        block.extend(name.as_bytes());
        // Names are filled up to four bytes.
        block.push(0);
        block.extend([serial, density * 96 * 1024].iter().flat_map(|word| word.to_le_bytes()));
        let property = self.atom("_XSETTINGS_SETTINGS");
        let changed =
            self.connection.change_property8(PropMode::REPLACE, self.settings, property, property, &block);
        changed.expect("sent").check().expect("changed");
    }

    /// Tells the window its place and size, as managers of windows do when they have moved it.
    pub(crate) fn tell_place(&self, window: &str, width: u16, height: u16) {
        let window = window.parse().expect("a number");
        let event = ConfigureNotifyEvent {
            response_type: CONFIGURE_NOTIFY_EVENT,
            event: window,
            window,
            width,
            height,
            ..Default::default()
        };
        let sent = self.connection.send_event(false, window, EventMask::STRUCTURE_NOTIFY, event);
        sent.expect("sent").check().expect("told");
    }

    /// Says in the window's state whether it is minimised, and does no more than that.
    pub(crate) fn set_minimized(&self, window: &str, is_minimized: bool) {
        let window = window.parse().expect("a number");
        let states = if is_minimized { vec![self.atom("_NET_WM_STATE_HIDDEN")] } else { vec![] };
        let property = self.atom("_NET_WM_STATE");
        let replace = PropMode::REPLACE;
        let changed = self.connection.change_property32(replace, window, property, AtomEnum::ATOM, &states);
        changed.expect("sent").check().expect("changed");
    }
}

// The link to a Falcon that is plugged in, over libusb.
#pragma once

#include "devices/falcon/link.h"
#include "devices/falcon/usb_port.h"

#include <memory>

namespace haptrace {

/// Opens and claims it, and asks the chip from then on for what it has received. A kernel's serial driver (ftdi_sio) is
/// put aside as long as the link is open; no other is. Events are handled by whoever calls, no thread is made for
/// them (libusb has one of its own that watches for devices).
///
/// An endpoint that stalls is cleared and used on. Throws Error(device) with the cause and the remedy.
std::unique_ptr<FalconLink> open_usb_falcon_link(const FalconPort& port);

/// Takes the chip's status out of what one transfer brought: the first two bytes of every packet of `packet` bytes, the
/// last of which may be shorter. What remains is at the beginning of `bytes`; returns how many there are.
std::size_t strip_ftdi_status(std::span<std::uint8_t> bytes, std::size_t packet) noexcept;

}  // namespace haptrace

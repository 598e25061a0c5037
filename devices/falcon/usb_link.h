// Link to a Falcon over USB, with libusb.
#pragma once

#include "devices/falcon/link.h"
#include "devices/falcon/usb_port.h"

#include <memory>

namespace haptrace {

/// Opens and claims the device, and from then on keeps asking the chip for received bytes. Detaches the kernel's serial
/// driver (ftdi_sio) while the link is open, but no other driver. The calling thread handles events; no thread is
/// created for them (libusb itself has one that watches for devices).
///
/// Clears a stalled endpoint and continues to use it. Throws Error(device) with the cause and the remedy.
std::unique_ptr<FalconLink> open_usb_falcon_link(const FalconPort& port);

/// Removes the chip's status from the bytes of one transfer: the first two bytes of every packet of `packet` bytes, of
/// which the last may be shorter. Moves the remaining bytes to the beginning of `bytes` and returns their number.
std::size_t strip_ftdi_status(std::span<std::uint8_t> bytes, std::size_t packet) noexcept;

}  // namespace haptrace

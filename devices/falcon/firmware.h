// Loading of a Falcon's firmware, which the device loses with its power.
#pragma once

#include "devices/falcon/link.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Firmware from a file of the user. It is Novint's, and haptrace contains none of it.
struct FalconFirmware {
  static constexpr std::size_t kLeast = 4'096, kMost = 32'768;  ///< plausible sizes [bytes]; known files have 7 to 9 kB

  std::string file;
  std::vector<std::uint8_t> image;
};

/// Reads firmware from a file. Throws Error(input) if the file cannot be read or its size is implausible.
FalconFirmware read_falcon_firmware(const std::string& file);

using OpenFalconLink = std::function<std::unique_ptr<FalconLink>()>;

/// Returns a link to firmware that runs and answers. Loads nothing if firmware already runs, for example after an
/// earlier session. Loading is known to need several tries, so there are 10, each on a new link. No force acts before
/// or after.
///
/// The loader protocol is that of libnifalcon (FalconCommLibUSB::setFirmwareMode): a greeting at 9600 baud, an 'A' at
/// 142 857 baud, then the image, of which the loader echoes every byte.
///
/// Throws Error(device) if `open` does, if no firmware runs and none is given, or with the cause of each failed try.
/// May last half a minute.
std::unique_ptr<FalconLink> start_falcon(const OpenFalconLink& open, const std::optional<FalconFirmware>& firmware);

}  // namespace haptrace

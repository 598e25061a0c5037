// Getting a Falcon's firmware to run, which it loses with its power.
#pragma once

#include "devices/falcon/link.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// A file of the user's: the firmware is Novint's, and nothing of it comes with haptrace.
struct FalconFirmware {
  static constexpr std::size_t kLeast = 4'096, kMost = 32'768;  ///< plausible sizes; known ones have 7 to 9 kB

  std::string file;
  std::vector<std::uint8_t> image;
};

/// Throws Error(input) when it cannot be read or cannot be one by its size.
FalconFirmware read_falcon_firmware(const std::string& file);

using OpenFalconLink = std::function<std::unique_ptr<FalconLink>()>;

/// A link to firmware that runs and answers. If it does so already, as after an earlier session, nothing is loaded.
/// Loading is known to need several tries: there are 10, each on a link of its own. No force acts before or after.
///
/// The loader is spoken to as libnifalcon does (FalconCommLibUSB::setFirmwareMode): a greeting at 9600 baud, an 'A' at
/// 142 857 baud, then the image, of which every byte comes back.
///
/// Throws Error(device): what `open` throws, that no firmware runs and none was named, or what went wrong in each try.
/// May last half a minute.
std::unique_ptr<FalconLink> start_falcon(const OpenFalconLink& open, const std::optional<FalconFirmware>& firmware);

}  // namespace haptrace

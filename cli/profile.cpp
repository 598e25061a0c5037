#include "cli/profile.h"

#include "control/error.h"

#include <fmt/format.h>

namespace haptrace::cli {

std::optional<DeviceProfile> profile_for(const DeviceInfo& info, const std::string& file, double rate_hz,
                                         const Output& output) {
  const bool asked = !file.empty();
  std::optional<DeviceProfile> profile;
  try {
    profile = asked ? load_profile(file) : find_profile(identity_of(info));
  } catch (const Error& error) {
    if (asked) throw;
    output.remark(fmt::format("{}; it is not used", error.what()));
  }
  if (!profile) return std::nullopt;
  const std::string reason = check_profile(*profile, identity_of(info), facts_of(info), rate_hz);
  if (reason.empty()) return profile;
  if (asked) throw input_error(fmt::format("{}: {}", file, reason));
  output.remark(fmt::format("{} is not used: {}", profile_file(identity_of(info)), reason));
  return std::nullopt;
}

std::optional<IdentifiedDevice> identified_device(const DeviceInfo& info, const std::string& file, bool no_profile,
                                                  double rate_hz, const Output& output) {
  if (no_profile && !file.empty()) throw input_error("--profile and --no-profile exclude each other");
  if (no_profile) return std::nullopt;
  const auto profile = profile_for(info, file, rate_hz, output);
  if (!profile) return std::nullopt;
  return IdentifiedDevice{profile->plant, profile->design};
}

}  // namespace haptrace::cli

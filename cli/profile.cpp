#include "cli/profile.h"

#include "base/error.h"
#include "base/rfc3339.h"
#include "player/motor_limit.h"

#include <chrono>
#include <fmt/format.h>

namespace haptrace::cli {

std::optional<DeviceProfile> profile_for(const DeviceInfo& info, const std::string& file, double rate_hz,
                                         const Output& output, std::vector<Warning>* warnings) {
  const bool asked = !file.empty();
  const auto warn = [&](std::string text) {
    Warning warning{.code = "profile", .text = std::move(text)};
    output.warn(warning);
    if (warnings != nullptr) warnings->push_back(std::move(warning));
  };
  std::optional<DeviceProfile> profile;
  try {
    profile = asked ? load_profile(file) : find_profile(identity_of(info));
  } catch (const Error& error) {
    if (asked) throw;
    warn(fmt::format("{}; it is not used", error.what()));
  }
  if (!profile) return std::nullopt;
  const std::string reason = check_profile(*profile, identity_of(info), facts_of(info), rate_hz);
  if (reason.empty()) return profile;
  if (asked) throw input_error(fmt::format("{}: {}", file, reason));
  warn(fmt::format("{} is not used: {}", profile_file(identity_of(info)), reason));
  return std::nullopt;
}

void take_motor_limit(const DeviceProfile& profile, const DeviceInfo& info, const Output& output,
                      SessionOptions& session) {
  if (bound_by_motors(session, info, profile.plant)) output.warn(session.known.back());
}

DeviceProfile profile_of(const DeviceInfo& info, const CalibrationResult& result, double rate_hz) {
  return {.device = identity_of(info),
          .facts = facts_of(info),
          .created = rfc3339(std::chrono::system_clock::now()),
          .software = software_name(),
          .rate_hz = rate_hz,
          .plant = result.identification.plant,
          .half_width = result.identification.half_width,
          .line_residual = result.identification.line_residual,
          .sweep_residual = result.identification.sweep_residual,
          .fits = result.identification.fits,
          .coarse = result.identification.coarse,
          .reason = result.doubt,
          .design = *result.design,
          .held = result.held};
}

void keep_dynamics(SessionOptions& session, const DeviceInfo& info, const std::optional<DeviceProfile>& profile) {
  if (session.recording && info.measures_force && profile)
    session.recording->meta[kDynamicsKey] = to_json(DeviceDynamics::of(*profile)).dump();
}

void ProfileArguments::add_to(CLI::App& verb, const char* group, const char* without) {
  verb.add_option("--profile", file, "device profile from calibrate (default: the profile stored for this device)")
      ->type_name("FILE.json")
      ->group(group);
  verb.add_flag("--no-profile", none, without)->group(group);
}

void ProfileArguments::check() const {
  if (none && !file.empty()) throw input_error("--profile and --no-profile exclude each other");
}

std::optional<DeviceProfile> ProfileArguments::find(const DeviceInfo& info, double rate_hz, const Output& output,
                                                    std::vector<Warning>* warnings) const {
  check();
  return none ? std::nullopt : profile_for(info, file, rate_hz, output, warnings);
}

std::string ProfileArguments::used(const DeviceInfo& info) const {
  return file.empty() ? profile_file(identity_of(info)) : file;
}

}  // namespace haptrace::cli

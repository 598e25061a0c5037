#include "formats/documents/expert_recording.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/json_reader.h"
#include "formats/path/expert_force.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr EnumNames<ReplayedForce, 3> kForces{"force of the expert", {"task", "measured", "sent"}};
constexpr const char* kProfileBeside = "profile.json";  // as in the folder of a session

/// The model of the expert's device, and where it was found.
struct Found {
  DeviceDynamics dynamics;
  DeviceIdentity device;
  std::string where;
};

Found found_in(const DeviceProfile& profile, const std::string& where) {
  return {DeviceDynamics::of(profile), profile.device, where};
}

/// Returns the model of its device that a recording holds.
std::optional<Found> found_in(const RecordingHeader& header, const DeviceIdentity& expert, const std::string& file) {
  const auto text = header.meta.find(kDynamicsKey);
  if (text == header.meta.end()) return std::nullopt;
  const std::string where = fmt::format("{}: {}", file, kDynamicsKey);
  return Found{dynamics_from_json(parse_json(text->second, where), where), expert, "as the recording states"};
}

/// Searches the model of the device `expert` with which `file` was recorded.
std::optional<Found> find_expert_device(const std::string& file, const RecordingHeader& header,
                                        const DeviceIdentity& expert, const ExpertOptions& options,
                                        const std::optional<DeviceProfile>& known, ExpertRecording& result) {
  if (!options.profile.empty()) {
    Found found = found_in(load_profile(options.profile), options.profile);
    if (found.device != expert)
      result.warnings.push_back(fmt::format("{} is the profile of {}, but {} was recorded with {}", options.profile,
                                            device_in_words(found.device), file, device_in_words(expert)));
    return found;
  }
  try {
    if (std::optional<Found> found = found_in(header, expert, file)) return found;
  } catch (const Error& error) {
    result.warnings.push_back(fmt::format("{}; it is not used for the expert's force", error.what()));
  }
  try {
    const std::filesystem::path beside = std::filesystem::path(file).parent_path() / kProfileBeside;
    if (std::filesystem::exists(beside))
      if (DeviceProfile profile = load_profile(beside.string()); profile.device == expert)
        return found_in(profile, beside.string());
    if (known && known->device == expert) return found_in(*known, "the profile of this session");
    if (std::optional<DeviceProfile> profile = find_profile(expert)) return found_in(*profile, profile_file(expert));
  } catch (const Error& error) {
    result.warnings.push_back(fmt::format("{}; it is not used for the expert's force", error.what()));
  }
  return std::nullopt;
}

HandleForce handle_of(const std::optional<Found>& found, bool negated) {
  HandleForce handle{.negated = negated};
  if (!found) return handle;
  handle.plant = found->dynamics.plant;
  handle.inertia = found->dynamics.inertia;
  return handle;
}

/// Adds what the survey of the forces says.
void judge(const std::string& name, const ForceSurvey& survey, const ExpertOptions& options, ExpertRecording& result) {
  if (survey.drives_the_hand())
    result.warnings.push_back(
        fmt::format("{}: the measured force drove the hand in free movement ({:+.0f} mJ over {:.2f} m), but a device's "
                    "drag takes energy from it: the sign of the sensor is probably reversed. Check it with 100 g on "
                    "the handle, which must read +0.98 N along z, and {} --negate-measured",
                    name, 1e3 * survey.work, survey.path_length, options.negated ? "leave out" : "give"));
  if (result.force != ReplayedForce::task) return;
  if (survey.only_the_device())
    result.warnings.push_back(fmt::format(
        "{}: the expert felt nothing but the device. {:.2f} N remain of the measured force, which is within "
        "the error of the measurement and of the device's model ({:.2f} N of drag)",
        name, survey.task, survey.drag));
}

/// Sets the force of `result` to the measured one, with or without the expert's device.
void use_measured(const std::string& name, const std::shared_ptr<const PathSource>& measured,
                  const std::optional<Found>& found, const ExpertOptions& options, ExpertRecording& result) {
  const std::shared_ptr<const PathSource> sent = result.path;
  const HandleForce handle = handle_of(found, options.negated);
  result.path = task_force(measured, handle);
  result.force = found ? ReplayedForce::task : ReplayedForce::measured;
  if (found)
    result.notes.push_back(
        fmt::format("{}: the replayed force is the task's, the measured force less the model of {} "
                    "({})",
                    name, device_in_words(found->device), found->where));
  else
    result.warnings.push_back(
        fmt::format("{}: the measured force is replayed with the inertia, friction and weight of the expert's "
                    "device; the trainee's device adds its own",
                    name));
  judge(name, survey_forces(*sent, measured, handle), options, result);
}

}  // namespace

ReplayedForce parse_replayed_force(std::string_view name) {
  return kForces.parse(name);
}

const char* to_string(ReplayedForce force) noexcept {
  return kForces.name(force);
}

ExpertRecording open_expert(const std::string& file, const ExpertOptions& options, const PathSelection& selection,
                            const RowsDone& progress, const CsvOptions& csv,
                            const std::optional<DeviceProfile>& known) {
  ExpertRecording result{.path = open_path(file, selection, progress, csv)};
  const std::string name = result.path->facts().name;
  if (result.path->facts().supported)
    result.notes.push_back(fmt::format("{}: the support of the expert's arm is left out of the force", name));
  const bool asked = options.force.has_value(), wants_sent = options.force == ReplayedForce::sent;
  if (!options.profile.empty()) (void)load_profile(options.profile);
  const auto note_useless = [&](const std::string& why) {
    for (const auto& [given, option] :
         {std::pair(!options.profile.empty(), "--expert-profile"), std::pair(options.negated, "--negate-measured")})
      if (given) result.notes.push_back(fmt::format("{}: {} has no effect: {}", name, option, why));
  };
  if (!result.path->facts().measured) {
    if (asked && !wants_sent)
      throw input_error(
          fmt::format("{} has no measured force; leave out --expert-force {}", name, to_string(*options.force)));
    note_useless("the recording has no measured force");
    return result;
  }
  if (wants_sent) {
    note_useless("the sent force is replayed");
    return result;
  }

  const RecordingHeader header = RecordingReader(file).header();
  const DeviceIdentity expert{header.device_backend, header.device_model, header.device_serial};
  std::optional<Found> found;
  if (options.force != ReplayedForce::measured)
    found = find_expert_device(file, header, expert, options, known, result);
  if (!found && options.force != ReplayedForce::measured) {
    const std::string why = fmt::format(
        "the model of its device ({}) is unknown, and the measured force is mostly the inertia and friction of that "
        "device; calibrate it (haptrace calibrate), or give its profile with --expert-profile",
        device_in_words(expert));
    if (asked) throw input_error(fmt::format("{}: {}", name, why));
    result.warnings.push_back(fmt::format("{}: its measured force is not replayed, but the sent force: {}", name, why));
    return result;
  }
  if (found && found->dynamics.in_a_hand) {
    const std::string why = fmt::format(
        "the model of its device ({}) was calibrated in a hand, so it has the drag and the pull of an arm; calibrate "
        "the device with nobody at the handle, into a file (haptrace calibrate -o free.json), and give that with "
        "--expert-profile",
        found->where);
    result.warnings.push_back(
        fmt::format("{}: {}{}", name, asked ? "" : "its measured force is not replayed, but the sent force: ", why));
    if (!asked) return result;
  }
  PathSelection of_sensor = selection;
  of_sensor.measured = true;
  of_sensor.negated = options.negated;
  const std::shared_ptr<const PathSource> measured = open_path(file, of_sensor, progress, csv);
  try {
    use_measured(name, measured, found, options, result);
  } catch (const Error& error) {
    if (asked) throw;
    result.warnings.push_back(fmt::format("{}; the sent force is replayed", error.what()));
  }
  return result;
}

}  // namespace haptrace

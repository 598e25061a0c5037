#include "devices/plugin/plugin_device.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/device_spec.h"
#include "devices/loop/loose_thread.h"
#include "devices/loop/watchdog.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <iterator>
#include <utility>

namespace haptrace {
namespace {

constexpr double kLongestPluginClose = 2;  // [s]
constexpr const char* kPluginRule =
    "a plug-in defines the four functions of devices/plugin.h with C linkage and default visibility";

Error refuse(const std::string& library, const std::string& why) {
  return device_error(fmt::format("plug-in {}: {}", library, why));
}

template <std::size_t size>
std::string terminated(char (&text)[size]) {
  text[size - 1] = '\0';
  return text;
}

DeviceInfo read_info(haptrace_plugin_info& raw, const std::string& file) {
  const auto expect = [&file](bool condition, const char* field, const char* rule) {
    if (!condition) throw refuse(file, fmt::format("its info's {} {}", field, rule));
  };

  DeviceInfo info;
  info.backend = "plugin";
  info.model = terminated(raw.model);
  info.serial = terminated(raw.serial);
  info.virtual_time = (raw.flags & 1U) != 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    info.force_axes[axis] = (raw.axes >> axis & 1U) != 0;
    info.torque_axes[axis] = (raw.axes >> (3 + axis) & 1U) != 0;
  }
  info.workspace_min = Vec3(raw.workspace_min);
  info.workspace_max = Vec3(raw.workspace_max);
  info.position_resolution = raw.position_resolution;
  info.max_force = raw.max_force;
  info.max_continuous_force = raw.max_continuous_force;
  info.nominal_rate = raw.nominal_rate;

  expect((raw.axes >> 6) == 0, "axes", "has bits beyond the six for force and torque");
  expect(is_finite(info.workspace_min) && is_finite(info.workspace_max), "workspace", "is not finite");
  expect((info.workspace_min.array() < info.workspace_max.array()).all(), "workspace_min",
         "must lie below workspace_max in every axis");
  expect(std::isfinite(info.position_resolution) && info.position_resolution >= 0, "position_resolution",
         "must be finite and not negative (0 when unknown)");
  expect(std::isfinite(info.max_force) && info.max_force > 0, "max_force", "must be finite and greater than 0 N");
  expect(std::isfinite(info.max_continuous_force) && info.max_continuous_force >= 0, "max_continuous_force",
         "must be finite and not negative (0 when unknown)");
  expect(std::isfinite(info.nominal_rate) && info.nominal_rate > 0, "nominal_rate",
         "must be finite and greater than 0 Hz");
  return info;
}

std::string read_options(const DeviceSpec& spec) {
  const auto option = spec.options.find("options");
  std::string text = option != spec.options.end() ? option->second : "{}";
  std::string where = fmt::format("--device '{}': options", spec.text);
  if (text.front() == '@') {
    where = text.substr(1);
    std::ifstream file(where, std::ios::binary);
    text.assign(std::istreambuf_iterator<char>(file), {});
    if (!file) throw input_error(fmt::format("{}: cannot be read; options=@FILE names a JSON file", where));
  }
  const nlohmann::json options = parse_json(text, where);
  if (!options.is_object()) throw input_error(where + ": expected a JSON object");
  return options.dump();
}

std::unique_ptr<Device> open_plugin(const DeviceSpec& spec) {
  const auto path = spec.options.find("path");
  if (path == spec.options.end())
    throw input_error(
        fmt::format("--device '{}': the option path is missing; use plugin:path=./libmine.so", spec.text));
  const std::string options = read_options(spec);
  if (!std::filesystem::is_regular_file(path->second))
    throw device_error(fmt::format("--device '{}': path: there is no file '{}'", spec.text, path->second));
  return std::make_unique<PluginDevice>(
      path->second, options, spec.text,
      spec.flag("global") ? SharedLibrary::Symbols::global : SharedLibrary::Symbols::local);
}

/// Runs `call` and converts its exceptions to Error(device) naming the plug-in.
template <class Call>
auto calling(const std::string& library, const std::string& words, Call call) {
  const ForeignCall foreign(words.c_str());
  try {
    return call();
  } catch (const std::exception& error) {
    throw refuse(library, fmt::format("threw an exception while it was opened: {}", error.what()));
  } catch (...) {
    throw refuse(library, "threw an exception while it was opened");
  }
}

/// Loads the library as a ForeignCall, because loading runs its initialisers.
std::shared_ptr<SharedLibrary> loaded(const std::string& library, SharedLibrary::Symbols symbols,
                                      const std::string& words) {
  const ForeignCall foreign(words.c_str());
  return std::make_shared<SharedLibrary>("plug-in", library, SharedLibrary::Unload::with_this, symbols);
}

}  // namespace

PluginDevice::PluginDevice(const std::string& library, const std::string& options, const std::string& name,
                           SharedLibrary::Symbols symbols)
    : words_("the plug-in " + library) {
  library_ = loaded(library, symbols, words_);
  const decltype(&haptrace_plugin_abi) abi = library_->function("haptrace_plugin_abi", kPluginRule);
  const std::uint32_t version = calling(library, words_, [&] { return abi(); });
  if (version == 0 && symbols == SharedLibrary::Symbols::local)
    throw refuse(
        library,
        "reports version 0 of the plug-in ABI, as a Python plug-in does if its interpreter does not start. If Python "
        "modules lack symbols, make the plug-in's symbols visible to them: plugin:path=...,global=true");
  if (version != HAPTRACE_PLUGIN_ABI)
    throw refuse(library, fmt::format("uses version {} of the plug-in ABI, but this haptrace uses {}; rebuild the "
                                      "plug-in with this haptrace's devices/plugin.h",
                                      version, HAPTRACE_PLUGIN_ABI));
  const decltype(&haptrace_plugin_open) open = library_->function("haptrace_plugin_open", kPluginRule);
  exchange_ = library_->function("haptrace_plugin_exchange", kPluginRule);
  close_ = library_->function("haptrace_plugin_close", kPluginRule);
  sample_ = library_->function_if_any("haptrace_plugin_sample");
  stop_ = library_->function_if_any("haptrace_plugin_stop");

  haptrace_plugin_info raw{};
  raw.struct_size = sizeof(raw);
  char error[512] = {};
  void* device = nullptr;
  const int result =
      calling(library, words_, [&] { return open(options.c_str(), &device, &raw, error, sizeof(error)); });
  if (result < 0) {
    const std::string why = terminated(error);
    throw refuse(library, why.empty() ? fmt::format("refuses to open ({}) and gives no reason", result) : why);
  }
  device_ = device;
  try {
    info_ = read_info(raw, library);
    info_.name = name;
    // Only an exchange shows which quantities the plug-in measures. This one applies no force and advances no time.
    DeviceState state;
    if (exchange({}, 0, state) == Status::lost) throw refuse(library, lost_reason());
    info_.measures_velocity = is_finite(state.velocity);
    info_.measures_orientation = state.orientation.coeffs().allFinite();
    info_.measures_force = is_finite(state.force);
  } catch (...) {
    close();
    throw;
  }
}

PluginDevice::~PluginDevice() {
  close();
}

Device::Status PluginDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (close_ == nullptr || failure_ < 0) return Status::lost;
  const auto [force, torque] = sendable(wrench);
  const std::array<double, 6> sent{force.x(), force.y(), force.z(), torque.x(), torque.y(), torque.z()};
  haptrace_plugin_state raw{};
  for (double& v : raw.velocity) v = kNaN;
  for (double& q : raw.orientation) q = kNaN;
  for (double& f : raw.force) f = kNaN;
  const bool zero = force.isZero(0) && torque.isZero(0);
  if (!zero) zero_ = ZeroForce::failed;
  haptrace_plugin_sample_info sample{};
  sample.struct_size = sizeof sample;
  const ForeignCall foreign(words_.c_str());
  try {
    failure_ = std::min(exchange_(device_, dt > 0 ? dt : 0, sent.data(), &raw), 0);
    if (failure_ == 0 && sample_ != nullptr) sample_(device_, &sample);
  } catch (const std::exception& error) {
    remember_thrown(error.what());
  } catch (...) {
    remember_thrown("an object that is not a std::exception");
  }
  if (failure_ < 0) return Status::lost;
  if (zero) zero_ = ZeroForce::confirmed;
  state = DeviceState{};
  state.position = Vec3(raw.position);
  state.velocity = Vec3(raw.velocity);
  state.orientation = Quat(raw.orientation[0], raw.orientation[1], raw.orientation[2], raw.orientation[3]);
  state.force = Vec3(raw.force);
  state.buttons = raw.buttons;
  state.ready = raw.ready != 0;
  state.sequence = sample.sequence;
  state.age = sample.age > 0 ? sample.age : 0;  // 0 for NaN, too
  return Status::ok;
}

/// Called in the tick, so it does not allocate.
void PluginDevice::remember_thrown(const char* what) noexcept {
  failure_ = -1;
  std::strncpy(thrown_.data(), what, thrown_.size() - 1);
}

void PluginDevice::close() noexcept {
  if (close_ == nullptr) return;
  const bool closed = call_within(kLongestPluginClose, [library = library_, close = std::exchange(close_, nullptr),
                                                        device = device_, words = words_] {
    const ForeignCall foreign(words.c_str(), ForeignCall::Thread::loose);
    try {
      close(device);
    } catch (...) {
      // The device is closed as far as possible.
    }
  });
  if (!closed) zero_ = ZeroForce::failed;
}

ZeroForce PluginDevice::zero_force() noexcept {
  return zero_;
}

ZeroForce PluginDevice::emergency_stop() noexcept {
  if (stop_ == nullptr || zero_ == ZeroForce::confirmed) return zero_;
  const ForeignCall foreign(words_.c_str());
  try {
    return stop_(device_) == 0 ? ZeroForce::confirmed : ZeroForce::failed;
  } catch (...) {
    return ZeroForce::failed;
  }
}

std::string PluginDevice::lost_reason() const {
  if (thrown_[0] != '\0') return fmt::format("the plug-in threw an exception in exchange: {}", thrown_.data());
  if (failure_ < 0) return fmt::format("the plug-in lost its device (exchange returned {})", failure_);
  return "the plug-in is closed";
}

DeviceBackend plugin_backend() {
  return {.name = "plugin",
          .summary = "a device in a shared library of your own (devices/plugin.h)",
          .options = {{"path", "path of the library, for example ./libmine.so"},
                      {"global",
                       "true: make its symbols visible to other libraries, as modules of an embedded Python need"},
                      {"options", "JSON object for the plug-in, or @FILE; must be the last option"}},
          .presets = {},
          .open = open_plugin};
}

}  // namespace haptrace

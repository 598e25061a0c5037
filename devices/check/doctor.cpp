#include "devices/check/doctor.h"

#include "base/error.h"
#include "base/number.h"
#include "base/system_files.h"
#include "base/units.h"
#include "control/controller.h"
#include "control/event_words.h"
#include "control/velocity_estimator.h"
#include "devices/check/usb_devices.h"
#include "devices/loop/realtime.h"
#include "devices/loop/servo_loop.h"
#include "devices/registry.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <sstream>
#include <string_view>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using system_files::entries, system_files::read_text;

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

Diagnosis unknown(const std::string& check, const std::string& why) {
  return {Severity::note, check, "unknown: " + why, ""};
}

// ---- the kernel ----

Diagnosis examine_governor(const fs::path& root) {
  constexpr const char* kCheck = "cpu governor";
  std::vector<std::string> others;
  std::size_t cpus = 0;
  for (const fs::path& cpu : entries(root / "sys/devices/system/cpu")) {
    const std::string name = cpu.filename();
    if (name.size() < 4 || !name.starts_with("cpu") || std::isdigit(static_cast<unsigned char>(name[3])) == 0) continue;
    const auto governor = read_text(cpu / "cpufreq/scaling_governor");
    if (!governor) continue;
    ++cpus;
    if (*governor != "performance" && std::find(others.begin(), others.end(), *governor) == others.end())
      others.push_back(*governor);
  }
  if (cpus == 0) return unknown(kCheck, "no frequency scaling is visible (a fixed clock, or a virtual machine)");
  if (others.empty()) return {Severity::ok, kCheck, fmt::format("performance, {} processors", cpus), ""};
  return {Severity::warning, kCheck,
          fmt::format("{}: a slow processor clock makes ticks late", fmt::join(others, ", ")),
          "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"};
}

/// Preemption model of the kernel, and its source.
struct Preemption {
  std::string model;   ///< "rt", "full", "lazy", "voluntary", "none"; empty when unknown
  std::string source;  ///< file below the root
  bool dynamic = false;
};

Preemption find_preemption(const fs::path& root) {
  const std::string version = read_text(root / "proc/version").value_or("");
  Preemption found{.dynamic = version.find("PREEMPT_DYNAMIC") != std::string::npos};
  const auto is = [&](const std::string& model, const std::string& source) {
    found.model = model;
    found.source = source;
    return found;
  };
  if (read_text(root / "sys/kernel/realtime") == "1") return is("rt", "/sys/kernel/realtime");
  if (version.find("PREEMPT_RT") != std::string::npos) return is("rt", "/proc/version");

  // "none voluntary (full)"; only root can read it, and only if debugfs is mounted.
  if (const auto choice = read_text(root / "sys/kernel/debug/sched/preempt")) {
    const std::size_t open = choice->find('('), close = choice->find(')', open);
    if (close != std::string::npos)
      return is(choice->substr(open + 1, close - open - 1), "/sys/kernel/debug/sched/preempt");
  }
  if (found.dynamic)
    for (const std::string& word : words_of(read_text(root / "proc/cmdline").value_or("")))
      if (word.starts_with("preempt=")) return is(word.substr(8), "/proc/cmdline");

  const std::string release = read_text(root / "proc/sys/kernel/osrelease").value_or("");
  for (const std::string& file : {"/boot/config-" + release, std::string("/proc/config.gz")}) {
    const auto lines = lines_of(read_text(root / file.substr(1)).value_or(""));
    for (const auto& [key, model] :
         {std::pair{"RT", "rt"}, {"LAZY", "lazy"}, {"VOLUNTARY", "voluntary"}, {"NONE", "none"}})
      if (std::find(lines.begin(), lines.end(), fmt::format("CONFIG_PREEMPT_{}=y", key)) != lines.end())
        return is(model, file);
    if (std::find(lines.begin(), lines.end(), "CONFIG_PREEMPT=y") != lines.end()) return is("full", file);
  }
  if (!found.dynamic && version.find(" PREEMPT ") != std::string::npos) return is("full", "/proc/version");
  return found;
}

Diagnosis examine_preemption(const fs::path& root) {
  constexpr const char* kCheck = "preemption";
  const Preemption found = find_preemption(root);
  if (found.model.empty()) return unknown(kCheck, "the kernel's configuration cannot be read");
  const std::string measured = fmt::format("{}{} ({})", found.model == "rt" ? "PREEMPT_RT" : found.model,
                                           found.dynamic ? ", can be changed at run time" : "", found.source);
  const std::string remedy = found.dynamic
                                 ? "echo full | sudo tee /sys/kernel/debug/sched/preempt   # to keep it: preempt=full "
                                   "in GRUB_CMDLINE_LINUX of /etc/default/grub, sudo update-grub"
                                 : "sudo apt install linux-image-rt-$(dpkg --print-architecture)   # and boot it";
  if (found.model == "none") return {Severity::warning, kCheck, measured, remedy};
  if (found.model == "voluntary") return {Severity::note, kCheck, measured, remedy};
  return {Severity::ok, kCheck, measured, ""};
}

// ---- devices ----

std::vector<Diagnosis> examine_permissions(const PluggedUsbDevice& device) {
  const std::string check = "device " + device.ids, name = fmt::format("{} at {}", device.known->name, device.port);
  if (device.nodes.empty())
    return {{Severity::problem, check, fmt::format("{}: {}", name, device.obstacle), device.remedy}};
  std::vector<Diagnosis> found;
  for (const UsbNode& node : device.nodes)
    if (node.obstacle.empty())
      found.push_back({Severity::ok, check, fmt::format("{}: {} can be opened", name, node.path), ""});
    else
      found.push_back(
          {Severity::problem, check, fmt::format("{}: {}: {}", name, node.path, node.obstacle), node.remedy});
  return found;
}

Diagnosis examine_autosuspend(const fs::path& root, const PluggedUsbDevice& device) {
  const std::string check = "autosuspend " + device.ids;
  const auto control = read_text(root / "sys/bus/usb/devices" / device.port / "power/control");
  if (!control) return unknown(check, "its power/control cannot be read");
  if (*control == "on") return {Severity::ok, check, "off", ""};
  return {Severity::warning, check, fmt::format("{} may suspend between two exchanges", device.known->name),
          fmt::format("echo on | sudo tee /sys/bus/usb/devices/{}/power/control", device.port)};
}

Diagnosis examine_autosuspend_default(const fs::path& root) {
  constexpr const char* kCheck = "usb autosuspend";
  const auto seconds = number_of<int>(read_text(root / "sys/module/usbcore/parameters/autosuspend").value_or(""));
  if (!seconds) return unknown(kCheck, "no USB bus is visible");
  if (*seconds < 0) return {Severity::ok, kCheck, "off", ""};
  return {Severity::note, kCheck, fmt::format("devices that allow it suspend after {} s", *seconds),
          "echo -1 | sudo tee /sys/module/usbcore/parameters/autosuspend   # before plugging a device in"};
}

std::vector<Diagnosis> examine_latency_timers(const fs::path& root) {
  std::vector<Diagnosis> found;
  for (const fs::path& port : entries(root / "sys/bus/usb-serial/devices")) {
    const std::string name = port.filename(), check = "latency timer " + name;
    std::error_code error;
    if (!fs::exists(port / "latency_timer", error)) continue;  // only FTDI's chips have one
    const auto ms = number_of<int>(read_text(port / "latency_timer").value_or(""));
    if (!ms)
      found.push_back(unknown(check, "latency_timer cannot be read"));
    else if (*ms <= 1)
      found.push_back({Severity::ok, check, fmt::format("{} ms", *ms), ""});
    else
      found.push_back({Severity::warning, check, fmt::format("{} ms: answers come in bursts", *ms),
                       fmt::format("echo 1 | sudo tee /sys/bus/usb-serial/devices/{}/latency_timer", name)});
  }
  if (found.empty()) found.push_back({Severity::ok, "latency timer", "no FTDI serial port is plugged in", ""});
  return found;
}

/// Returns true if a line of the rules that udev reads names the device.
bool has_rule(const std::string& rules, const KnownUsbDevice& device) {
  const auto lines = lines_of(rules);
  return std::any_of(lines.begin(), lines.end(), [&](std::string line) {
    std::transform(line.begin(), line.end(), line.begin(), [](unsigned char c) { return std::tolower(c); });
    if (line.find_first_not_of(" \t") == line.find('#')) return false;
    const auto names = [&](const char* key, const std::string& id) {
      return line.find(fmt::format("{{{}}}==\"{}\"", key, id)) != std::string::npos;
    };
    return names("idvendor", device.vendor) &&
           (line.find("idproduct") == std::string::npos || names("idproduct", device.product));
  });
}

Diagnosis examine_rules(const fs::path& root, const std::vector<PluggedUsbDevice>& plugged) {
  constexpr const char* kCheck = "udev rules";
  std::string rules;
  for (const char* folder : {"etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d",
                             "usr/lib/udev/rules.d", "lib/udev/rules.d"})
    for (const fs::path& file : entries(root / folder))
      if (file.extension() == ".rules") rules += read_text(file).value_or("") + "\n";

  for (const PluggedUsbDevice& device : plugged)
    if (!has_rule(rules, *device.known))
      return {Severity::warning, kCheck, fmt::format("no rule names {} ({})", device.ids, device.known->name),
              device.known->install_rule()};
  if (!plugged.empty()) return {Severity::ok, kCheck, "the rules name every device that is plugged in", ""};

  std::vector<std::string> missing;
  for (const KnownUsbDevice& device : known_usb_devices())
    if (!has_rule(rules, device)) missing.emplace_back(device.name);
  if (missing.empty()) return {Severity::ok, kCheck, "the rules name every known device; none is plugged in", ""};
  return {Severity::note, kCheck,
          fmt::format("no known device is plugged in; no rule names: {}", fmt::join(missing, ", ")),
          fmt::format("haptrace doctor --udev-rules | sudo tee {} && {}", kUdevRulesFile, kReloadUdevRules)};
}

// ---- limits ----

/// Returns the soft limit of this process in the words of /proc/self/limits.
std::optional<std::string> process_limit(const fs::path& root, const std::string& name) {
  for (const std::string& line : lines_of(read_text(root / "proc/self/limits").value_or("")))
    if (line.starts_with(name)) {
      const auto words = words_of(line.substr(name.size()));
      if (!words.empty()) return words.front();
    }
  return {};
}

bool may_set_priorities(const fs::path& root) {
  constexpr unsigned kSysNice = 23;  // CAP_SYS_NICE
  for (const std::string& line : lines_of(read_text(root / "proc/self/status").value_or("")))
    if (line.starts_with("CapEff:"))
      return ((number_of<std::uint64_t>(words_of(line).back(), 16).value_or(0) >> kSysNice) & 1U) != 0;
  return false;
}

/// Returns the command that raises a limit for this user: `item` is "rtprio" or "memlock".
std::string raise_limit(const fs::path& root, const std::string& item) {
  std::vector<fs::path> files = entries(root / "etc/security/limits.d");
  files.push_back(root / "etc/security/limits.conf");
  for (const fs::path& file : files) {
    if (file.extension() != ".conf") continue;
    for (const std::string& line : lines_of(read_text(file).value_or(""))) {
      const auto words = words_of(line);  // domain, type, item, value
      if (words.size() < 4 || words[0][0] == '#' || words[2] != item) continue;
      const bool enough =
          words[3] == "unlimited" || (item == "rtprio" && number_of<int>(words[3]).value_or(0) >= kServoPriority);
      if (!enough) continue;
      const std::string where = fmt::format("/etc/security/{}", fs::relative(file, root / "etc/security").string());
      if (words[0][0] == '@')
        return fmt::format("sudo usermod -aG {} $USER   # and log in again: {} allows this group", words[0].substr(1),
                           where);
      return fmt::format("su - $USER   # or log in again: {} allows {}", where, words[0]);
    }
  }
  return fmt::format(
      "sudo groupadd -f realtime && sudo usermod -aG realtime $USER && printf '@realtime - rtprio {}\\n@realtime - "
      "memlock "
      "unlimited\\n' | sudo tee /etc/security/limits.d/haptrace.conf   # and log in again",
      kServoPriority);
}

Diagnosis examine_scheduling(const LoopMeasurement& loop, const fs::path& root) {
  constexpr const char* kCheck = "scheduling";
  if (loop.realtime.realtime) return {Severity::ok, kCheck, loop.realtime.scheduler, ""};
  const std::string limit = process_limit(root, "Max realtime priority").value_or("unknown");
  if (may_set_priorities(root) || number_of<int>(limit).value_or(0) >= kServoPriority)
    return {Severity::warning, kCheck,
            fmt::format("{}: SCHED_FIFO {} is permitted, but this control group has no real-time budget",
                        loop.realtime.scheduler, kServoPriority),
            "echo $$ | sudo tee /sys/fs/cgroup/cgroup.procs   # and start haptrace from this shell"};
  return {Severity::warning, kCheck,
          fmt::format("{}: SCHED_FIFO {} was refused, the limit rtprio is {}", loop.realtime.scheduler, kServoPriority,
                      limit),
          raise_limit(root, "rtprio")};
}

Diagnosis examine_memory_lock(const LoopMeasurement& loop, const fs::path& root) {
  constexpr const char* kCheck = "memory lock";
  std::string limit = process_limit(root, "Max locked memory").value_or("unknown");
  if (number_of<std::uint64_t>(limit)) limit += " bytes";
  if (loop.realtime.memory_locked) return {Severity::ok, kCheck, fmt::format("locked; the limit is {}", limit), ""};
  return {Severity::warning, kCheck, fmt::format("refused, the limit memlock is {}", limit),
          raise_limit(root, "memlock")};
}

Diagnosis examine_timer_slack(const LoopMeasurement& loop, const fs::path& root) {
  constexpr const char* kCheck = "timer slack";
  constexpr std::int64_t kFine = 1000;  // [ns]
  const std::string measured = fmt::format("{} ns", loop.timer_slack_ns);
  if (loop.realtime.realtime) return {Severity::ok, kCheck, measured + "; real-time threads have none", ""};
  if (loop.timer_slack_ns <= kFine) return {Severity::ok, kCheck, measured, ""};
  return {Severity::warning, kCheck, measured + ": every wake-up may be this late, because the kernel refused 1 ns",
          raise_limit(root, "rtprio")};
}

Diagnosis examine_hypervisor(const LoopMeasurement& loop, const fs::path& root) {
  constexpr const char* kCheck = "hypervisor";
  const auto cpuinfo = read_text(root / "proc/cpuinfo");
  if (!cpuinfo || !loop.stolen) return unknown(kCheck, "/proc/cpuinfo or /proc/stat cannot be read");
  const bool guest =
      cpuinfo->find(" hypervisor") != std::string::npos || read_text(root / "sys/hypervisor/type").has_value();
  if (*loop.stolen > 0)
    return {
        *loop.stolen > kMostMissed * loop.duration ? Severity::warning : Severity::note, kCheck,
        fmt::format("it took {} of the {:g} s: the longest latencies come from the hypervisor, not from this system",
                    duration_text(*loop.stolen), loop.duration),
        "measure without a virtual machine, or reserve processors for this one on the host"};
  if (guest)
    return {
        Severity::note, kCheck,
        "a virtual machine; its host took no processor time during the measurement, but may take some at another time",
        ""};
  return {Severity::ok, kCheck, "none", ""};
}

Diagnosis examine_rate(const LoopMeasurement& loop) {
  const std::string figures =
      fmt::format("{}; {} of {} ticks missed", quantiles_text(loop.latency), loop.missed, loop.samples + loop.missed);
  if (loop.holds_rate())
    return {Severity::ok, "servo loop", fmt::format("holds {:g} Hz: {}", loop.rate_hz, figures), ""};
  return {Severity::problem, "servo loop",
          fmt::format("does not hold {:g} Hz: {} (limits: {:g} % missed, p99.9 {})", loop.rate_hz, figures,
                      100 * kMostMissed, duration_text(kLatestWakeUp / loop.rate_hz)),
          fmt::format("haptrace doctor --rate {:g}   # after fixing the problems listed here", loop.rate_hz / 2)};
}

// ---- measuring ----

/// Sends no force until its time is over.
class HandsOff final : public Controller {
 public:
  explicit HandsOff(double duration) : end_ns_(std::llround(1e9 * duration)) {}
  [[nodiscard]] Command update(const State& state) noexcept override {
    Command command;
    if (state.time_ns >= end_ns_) command.status = Command::Status::finished;
    return command;
  }

 private:
  std::int64_t end_ns_;
};

}  // namespace

std::string quantiles_text(const DurationHistogram& durations) {
  return fmt::format("p50 {}, p99 {}, p99.9 {}, max {}", duration_text(durations.quantile(0.5)),
                     duration_text(durations.quantile(0.99)), duration_text(durations.quantile(0.999)),
                     duration_text(durations.max()));
}

std::vector<Diagnosis> examine_system(const std::string& root) {
  std::vector<Diagnosis> found{examine_governor(root), examine_preemption(root)};
  const auto add = [&](const std::vector<Diagnosis>& more) { found.insert(found.end(), more.begin(), more.end()); };
  const std::vector<PluggedUsbDevice> plugged = plugged_usb_devices(root);
  if (plugged.empty()) found.push_back(examine_autosuspend_default(root));
  for (const PluggedUsbDevice& device : plugged) {
    add(examine_permissions(device));
    found.push_back(examine_autosuspend(root, device));
  }
  found.push_back(examine_rules(root, plugged));
  add(examine_latency_timers(root));
  return found;
}

std::optional<double> stolen_time(const std::string& root) {
  // cpu user nice system idle iowait irq softirq steal, in clock ticks (proc(5))
  constexpr std::size_t kSteal = 8;
  const auto lines = lines_of(read_text(fs::path(root) / "proc/stat").value_or(""));
  if (lines.empty()) return {};
  const auto words = words_of(lines.front());
  if (words.size() <= kSteal || words[0] != "cpu") return {};
  const auto ticks = number_of<std::uint64_t>(words[kSteal]);
  if (!ticks) return {};
  return static_cast<double>(*ticks) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

bool LoopMeasurement::holds_rate() const noexcept {
  return samples > 0 && missed_fraction() <= kMostMissed && latency.quantile(0.999) <= kLatestWakeUp / rate_hz;
}

void measure_loop(LoopMeasurement& sum, double duration, const StopRequest& stop) {
  const auto device = open_device("sim:preset=falcon,hand=relaxed");
  const auto estimator = make_velocity_estimator("lowpass:100", sum.rate_hz, device->info().position_resolution);
  HandsOff controller(duration);
  ServoLoop loop(*device, controller, *estimator, {}, {.rate_hz = sum.rate_hz});

  ServoReport report;
  std::int64_t slack_ns = 0;
  const auto stolen_before = stolen_time();
  // The scheduling class ends with the thread.
  std::thread([&] {
    report = loop.run(stop);
    slack_ns = prctl(PR_GET_TIMERSLACK, 0UL, 0UL, 0UL, 0UL);
  }).join();
  const auto stolen_after = stolen_time();

  sum.duration += report.duration;
  sum.samples += report.samples;
  sum.missed += report.missed;
  sum.overruns += report.overruns;
  sum.latency.merge(report.latency);
  sum.p999_of_turns.push_back(report.latency.quantile(0.999));
  sum.realtime = report.realtime;
  sum.timer_slack_ns = slack_ns;
  if (stolen_before && stolen_after) sum.stolen = sum.stolen.value_or(0) + (*stolen_after - *stolen_before);
}

std::vector<Diagnosis> examine_loop(const LoopMeasurement& loop, const std::string& root) {
  return {examine_scheduling(loop, root), examine_memory_lock(loop, root), examine_timer_slack(loop, root),
          examine_hypervisor(loop, root), examine_rate(loop)};
}

std::optional<DurationHistogram> parse_cyclictest(const std::string& output) {
  constexpr std::int64_t kNanoseconds = 1000;  // in a microsecond
  DurationHistogram histogram;
  std::int64_t longest_us = 0;
  std::uint64_t beyond = 0;
  for (const std::string& line : lines_of(output)) {
    const auto words = words_of(line);
    if (line.starts_with("# Max Latencies:") && words.size() > 3)
      longest_us = number_of<std::int64_t>(words[3]).value_or(0);
    if (line.starts_with("# Histogram Overflows:") && words.size() > 3)
      beyond = number_of<std::uint64_t>(words[3]).value_or(0);
    if (words.size() < 2 || words[0][0] == '#') continue;
    const auto us = number_of<std::int64_t>(words[0]);
    const auto count = number_of<std::uint64_t>(words[1]);
    if (!us || !count) continue;
    histogram.record(kNanoseconds * *us, *count);
  }
  histogram.record(kNanoseconds * longest_us, beyond);
  if (histogram.count() == 0) return {};
  return histogram;
}

DurationHistogram measure_cyclictest(double rate_hz, double duration) {
  const std::string command = fmt::format(
      "cyclictest --quiet --policy=fifo --priority={} --interval={} --loops={} --mlockall --histogram=100000 2>&1",
      kServoPriority, std::llround(1e6 / rate_hz), std::max(1LL, std::llround(duration * rate_hz)));
  FILE* pipe = popen(command.c_str(), "re");
  if (pipe == nullptr)
    throw Error(Error::Kind::fault, fmt::format("cyclictest cannot be started: {}", std::strerror(errno)));
  std::string output;
  std::array<char, 4096> buffer{};
  std::size_t count = 0;
  while ((count = fread(buffer.data(), 1, buffer.size(), pipe)) > 0) output.append(buffer.data(), count);
  const int status = pclose(pipe);

  constexpr int kNotFound = 127;  // exit code of the shell
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNotFound)
    throw Error(Error::Kind::fault, "cyclictest is not installed: sudo apt install rt-tests");
  const auto histogram = parse_cyclictest(output);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || !histogram) {
    const auto lines = lines_of(output);
    throw Error(Error::Kind::fault,
                fmt::format("cyclictest cannot run at SCHED_FIFO {} ({}): {}", kServoPriority,
                            lines.empty() ? "it printed nothing" : lines.front(), raise_limit("/", "rtprio")));
  }
  return *histogram;
}

}  // namespace haptrace

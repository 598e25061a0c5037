// Common parts of the verbs: declaration, options of sessions, output of results.
#pragma once

#include "cli/keys.h"
#include "control/limits.h"
#include "devices/loop/watchdog.h"
#include "devices/registry.h"
#include "player/session.h"
#include "player/tuning/live_session.h"

#include <CLI/CLI.hpp>
#include <csignal>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace::cli {

/// The command's exit codes.
enum ExitCode : int {
  kDone = 0,
  kStopped = 1,       ///< a limit or fault stopped the session; data kept
  kBadInput = 2,      ///< bad usage or bad input
  kNoDevice = 3,      ///< device missing or lost
  kInterrupted = 130  ///< the user stopped the session; data kept
};

/// Output of results, for people or for programs.
struct Output {
  bool json = false;   ///< one JSON object on standard output
  bool quiet = false;  ///< no summary, progress or warnings; only errors

  /// Prints `json` or, unless quiet, `text`.
  void tell(const nlohmann::json& json_result, const std::string& text) const;
  /// Prints a remark for people on standard error; not with --quiet.
  void remark(const std::string& text) const;
  /// Prints the cause of a stop or of a loss of data on standard error, with --quiet too.
  void fault(const std::string& text) const;
  /// Prints a warning: an error as a fault, others as a remark.
  void warn(const Warning& warning) const;
};

/// A verb: a subcommand of `app`, and the function to run once its options are parsed.
struct Verb {
  CLI::App* app = nullptr;
  std::function<int(const Output&)> run;
};

/// Adds --partial, for verbs that read recordings in parts.
void add_partial(CLI::App& verb, bool& partial);
/// Returns the parts that such a verb reads.
RecordingReader::Parts parts_of(bool partial);

Verb add_devices(CLI::App& app);
Verb add_shape(CLI::App& app);
Verb add_average(CLI::App& app);
Verb add_record(CLI::App& app);
Verb add_play(CLI::App& app);
Verb add_guide(CLI::App& app);
Verb add_run(CLI::App& app);
Verb add_calibrate(CLI::App& app);
Verb add_view(CLI::App& app);
Verb add_info(CLI::App& app);
Verb add_check(CLI::App& app);
Verb add_scene(CLI::App& app);
Verb add_convert(CLI::App& app);
Verb add_recover(CLI::App& app);
Verb add_plot(CLI::App& app);
Verb add_report(CLI::App& app);
Verb add_doctor(CLI::App& app);
std::vector<Verb> add_stability(CLI::App& app);
Verb add_tradeoff(CLI::App& app);
std::vector<Verb> add_completion(CLI::App& app);

/// The options of every verb that runs a session.
struct SessionArguments {
  std::string device;
  double rate_hz = 1000;
  std::string clock = "auto";
  std::string velocity = "lowpass:100";
  std::optional<std::uint64_t> seed;
  SafetyLimits limits{.max_velocity = 1.5};
  double wait_for_device = 0;  ///< for verbs that can resume after a gap [s]
  double support = 0;          ///< for verbs that can support the arm [N]
  std::string up = "0,1,0";
  std::string title, subject, operator_name, notes, meta_file;
  std::vector<std::string> meta, mark_texts;
  std::string split, precision;
  double sync = 0;
  int compress = 0;
  bool overwrite = false;
  bool no_realtime = false;
  bool mark_buttons = false;
  bool keys = false;

  void add_to(CLI::App& app);
  /// Adds --wait-for-device, for verbs whose sessions can resume after a gap.
  void add_wait_to(CLI::App& app);
  /// Adds --support and --up, for verbs whose sessions can carry a part of the arm's weight.
  void add_support_to(CLI::App& app);

  /// Opens the device. Adds --seed and the `extra` options to its description if its backend has these options. With
  /// wait_for_device, reopens the device whenever it is lost.
  /// `number` counts the devices that a session opens one after another, from 0: each simulated one has another seed,
  /// because no hand does the same twice, and the session repeats with its first seed.
  [[nodiscard]] std::unique_ptr<Device> open(const std::vector<std::pair<std::string, std::string>>& extra = {},
                                             std::uint64_t number = 0) const;
  /// Returns the seed of the first device: that of --device, of --seed, or 1.
  [[nodiscard]] std::uint64_t first_seed() const;

  /// Returns the options of a session; without a `file`, it is not recorded. Throws Error(input) naming the option.
  [[nodiscard]] SessionOptions options(const std::string& file, const nlohmann::json& config) const;

 private:
  void add_loop_to(CLI::App& app);
  void add_safety_to(CLI::App& app);
  void add_metadata_to(CLI::App& app);
  void add_storage_to(CLI::App& app);
  void add_marks_to(CLI::App& app);
};

/// Throws Error(input) unless a required option of the verb was given, on the command line or in --config.
void require(const CLI::App& verb, const std::string& option);

/// An option, whether it has an effect beside the others, and what it needs for that ("--pace").
struct Dependence {
  const char* option;
  bool works;
  const char* needs;
};

/// Throws Error(input) that names the first option of the command line that has no effect. Options of --config may have
/// none: a recording keeps those of its whole session.
void refuse_useless(const CLI::App& verb, std::span<const Dependence> dependences);

/// Throws Error(input) if `output` is one of the files that the verb reads. Ignores empty names.
void keep_inputs(const std::string& output, std::span<const std::string> inputs);

/// Removes what killed processes left of `file`, and reports it.
void clean_up(const Output& output, const std::string& file);

/// Reads --config FILE.json: every key is an option of the verb; the command line takes precedence. A key that names a
/// verb holds options for that verb only.
void apply_config(CLI::App& verb, const std::string& file);
/// Applies a configuration that comes from `where`.
void apply_config(CLI::App& verb, const nlohmann::json& config, const std::string& where);

/// Returns every option of the verb with its effective value, in the format of a --config file.
nlohmann::json effective_config(const CLI::App& verb);

/// Ensures that no signal that can be caught ends or stops the process with a force in the motors. During its lifetime,
/// signals that would do so raise a stop request (SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP, SIGUSR1, SIGALRM, ...).
/// Signals of a dead pipe, a full quota or a terminal that refuses output are ignored. Construct it before a device is
/// opened, because opening one may move it. A Watchdog handles a crash during a session. Only one may exist at a time.
/// SIGKILL and SIGSTOP cannot be caught.
class Signals {
 public:
  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  [[nodiscard]] const StopRequest& stop() const noexcept;

 private:
  CrashWatch crashes_;
  std::vector<std::pair<int, struct sigaction>> before_;  ///< handlers to restore
};

/// Prints notes from before the session and makes them the session's first warnings.
void note_before(const Output& output, SessionOptions& session, const char* code, std::span<const std::string> texts,
                 Severity severity = Severity::note);

/// Throws Error(input) that names the first option of the command line which needs a recording, if there is none.
void refuse_unrecorded(const CLI::App& verb, bool recorded);

/// Warns of limits that the command line switched off, or that are above those of the device.
void note_limits(const Output& output, SessionOptions& session, const DeviceInfo& device);

/// Prints the notes on the limits, on the device and those on the path, which are warnings, makes them known to the
/// session, and returns them all. `path` names the path.
std::vector<std::string> note_device_and_path(const Output& output, SessionOptions& session, const DeviceInfo& device,
                                              const std::string& path, std::span<const std::string> of_path);

/// Returns a bar of 24 characters, filled up to `share` (0 to 1).
std::string meter(double share);

/// Returns a callback that prints warnings at once on standard error, and a progress line with live numbers if that is
/// a terminal. `duration` [s] of the session; 0: unknown. `keys` and `live` may be null; otherwise they must outlive
/// the result.
Progress progress_bar(const Output& output, double duration, const Keys* keys = nullptr,
                      const LiveSession* live = nullptr);

/// Returns the exit code of a session, and prints on standard error why it ended.
int conclude(const Output& output, const SessionResult& result);

/// Returns the rate, latency, losses and warnings of a session, as a few lines for people.
std::string session_summary(const SessionResult& result);

}  // namespace haptrace::cli

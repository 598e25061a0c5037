// What the verbs of the command share: how one is declared, what every session understands, how results are told.
#pragma once

#include "cli/keys.h"
#include "control/limits.h"
#include "devices/loop/watchdog.h"
#include "devices/registry.h"
#include "player/session.h"
#include "player/tuning/live_tuning.h"

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
  kInterrupted = 130  ///< data kept
};

/// Where results go: people or programs.
struct Output {
  bool json = false;   ///< one JSON object on standard output
  bool quiet = false;  ///< no summary, no progress, no warnings but errors

  /// Prints `json` or, unless quiet, `text`.
  void tell(const nlohmann::json& json_result, const std::string& text) const;
  /// Prints a remark for people on standard error; not with --quiet.
  void remark(const std::string& text) const;
  /// Prints what stopped a session or cost data on standard error, with --quiet too.
  void fault(const std::string& text) const;
  /// Prints a warning: an error as a fault, others as a remark.
  void warn(const Warning& warning) const;
};

/// One verb: a subcommand of `app` and what to run once its options are read.
struct Verb {
  CLI::App* app = nullptr;
  std::function<int(const Output&)> run;
};

/// Adds --partial, for verbs that read recordings in parts.
void add_partial(CLI::App& verb, bool& partial);
/// Which files such a verb reads.
RecordingReader::Parts parts_of(bool partial);

Verb add_devices(CLI::App& app);
Verb add_shape(CLI::App& app);
Verb add_record(CLI::App& app);
Verb add_play(CLI::App& app);
Verb add_guide(CLI::App& app);
Verb add_run(CLI::App& app);
Verb add_calibrate(CLI::App& app);
Verb add_info(CLI::App& app);
Verb add_check(CLI::App& app);
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
  double wait_for_device = 0;  ///< of verbs that can go on after a gap [s]
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
  /// --wait-for-device, for verbs whose sessions can go on after a gap.
  void add_wait_to(CLI::App& app);

  /// Opens the device, after --seed and `extra` options were put into its description where it understands them; with
  /// wait_for_device, again whenever it is lost.
  [[nodiscard]] std::unique_ptr<Device> open(const std::vector<std::pair<std::string, std::string>>& extra = {}) const;

  /// `file` empty: not recorded. Throws Error(input) naming the option.
  [[nodiscard]] SessionOptions options(const std::string& file, const nlohmann::json& config) const;
};

/// Throws Error(input) unless an option that the verb cannot do without was given, on the line or in --config.
void require(const CLI::App& verb, const std::string& option);

/// Throws Error(input) when `output` is one of the files that the verb reads; an empty name is no file.
void keep_inputs(const std::string& output, std::span<const std::string> inputs);

/// Removes what killed processes left of `file`, and says so.
void clean_up(const Output& output, const std::string& file);

/// Reads --config FILE.json: every key is an option of the verb; what stands on the line wins. A key that names a verb
/// holds what is for that verb alone.
void apply_config(CLI::App& verb, const std::string& file);
/// The same of a configuration that stands in `where`.
void apply_config(CLI::App& verb, const nlohmann::json& config, const std::string& where);

/// Every option of the verb with its value in force, as a --config file would hold them.
nlohmann::json effective_config(const CLI::App& verb);

/// From its construction to its end, no signal that can be caught ends or stops the process with a force in the motors:
/// those that would do so raise a stop request (SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP, SIGUSR1, SIGALRM, ...), and
/// those of a dead pipe, a full quota or a terminal that does not take output are ignored. To be made before a device
/// is opened, since opening one may move it. A crash during a session is left to its Watchdog. One at a time. SIGKILL
/// and SIGSTOP cannot be caught.
class Signals {
 public:
  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  [[nodiscard]] const StopRequest& stop() const noexcept;

 private:
  CrashWatch crashes_;
  std::vector<std::pair<int, struct sigaction>> before_;  ///< to restore
};

/// Prints notes that were made before the session and makes them the session's first warnings.
void note_before(const Output& output, SessionOptions& session, const char* code, std::span<const std::string> texts,
                 Warning::Severity severity = Warning::Severity::note);

/// 24 characters wide, of which the part `share`, 0 to 1, is full.
std::string meter(double share);

/// Prints warnings at once, on standard error, and a progress bar with live figures if that is a terminal.
/// `duration` [s] of the session; 0: unknown. `keys` and `tuning` may be null; else they must outlive the result.
Progress progress_bar(const Output& output, double duration, const Keys* keys = nullptr,
                      const LiveTuning* tuning = nullptr);

/// Returns the exit code of a session, and says what ended it on standard error.
int conclude(const Output& output, const SessionResult& result);

/// Returns rate, latency, losses and warnings of a session, a few lines for people.
std::string session_summary(const SessionResult& result);

}  // namespace haptrace::cli

// haptrace: records what a hand does with a force-feedback device, and plays it back.
#include "base/error.h"
#include "base/printable.h"
#include "base/suggest.h"
#include "cli/input_options.h"
#include "cli/terminal.h"
#include "cli/verb.h"
#include "devices/loop/loose_thread.h"
#include "devices/loop/watchdog.h"
#include "formats/documents/warning_json.h"
#include "recorder/recorded_devices.h"

#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

namespace haptrace::cli {
namespace {

constexpr const char* kDescription =
    "Records what a hand does with a force-feedback device, plays it back, and teaches it.\n\n"
    "A first session, without hardware:\n"
    "  haptrace shape square --size 0.08 --duration 8 -o square.h5\n"
    "  haptrace play square.h5 --device sim:preset=falcon,hand=relaxed --record played.h5\n"
    "  haptrace plot played.h5 -o played.png";

constexpr const char* kFooter =
    "Units are SI. Exit codes: 0 done; 1 a limit or fault stopped the session (data kept); 2 bad usage or input; "
    "3 device missing or lost; 130 interrupted (data kept).";

int exit_code(Error::Kind kind) {
  switch (kind) {
    case Error::Kind::input:
      return kBadInput;
    case Error::Kind::device:
      return kNoDevice;
    case Error::Kind::fault:
      return kStopped;
  }
  return kBadInput;
}

int report(const Output& output, int code, const std::string& text, const nlohmann::json& more = {}) {
  const std::string message = with_input_names(text);
  nlohmann::json json{{"error", message}, {"exit_code", code}};
  if (!more.is_null()) json.update(more);
  if (output.json) write_out(stdout, printable_json(json) + "\n");
  write_out(stderr, fmt::format("haptrace: {}\n", printable_lines(message)));
  return code;
}

std::vector<std::string> option_names(const CLI::App& verb) {
  std::vector<std::string> names;
  for (const CLI::Option* option : verb.get_options())
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  return names;
}

/// Verbs accept extras so that a slip is answered with the nearest option, not only refused.
void refuse_extras(const CLI::App& verb) {
  for (const std::string& word : verb.remaining()) {
    if (word.size() > 1 && word[0] == '-') {
      const std::string name = word.substr(0, word.find('='));
      throw input_error(fmt::format("unknown option '{}' of haptrace {}{}", name, verb.get_name(),
                                    suggestion(name, option_names(verb))));
    }
    throw input_error(fmt::format("'{}' is one word too many; see haptrace {} --help", word, verb.get_name()));
  }
}

/// Texts go into recordings, JSON and reports, all of which are UTF-8; names of files do too.
void refuse_invalid_texts(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options())
    for (const std::string& text : option->results())
      if (const std::size_t at = find_invalid_utf8(text); at != std::string::npos)
        throw input_error(
            fmt::format("{}: '{}' is not UTF-8 from byte {} on; type it in a terminal of that encoding, or rename the "
                        "file",
                        option->get_name(), printable(text), at + 1));
}

/// Refuses empty names: an empty name is usually a shell variable that is not set. The texts that describe a recording
/// may be empty, and so may options that take no value.
void refuse_empty_values(const CLI::App& verb) {
  static const std::vector<std::string> may_be_empty{"--title", "--subject", "--operator", "--notes"};
  for (const CLI::Option* option : verb.get_options()) {
    if (option->get_expected_min() == 0) continue;
    const std::string name = option->get_name();
    if (std::find(may_be_empty.begin(), may_be_empty.end(), name) != may_be_empty.end()) continue;
    for (const std::string& text : option->results())
      if (text.find_first_not_of(" \t\n") == std::string::npos)
        throw input_error(
            fmt::format("{}: is empty; give it a value, or leave it out (is a variable of the shell not "
                        "set?)",
                        name));
  }
}

/// A disk that is full has lost the results; a reader that has gone away did not want them. A session's are in its
/// file.
int with_results(int code, const CLI::App& verb) {
  const bool session = verb.get_option_no_throw("--device") != nullptr;
  if (!results_lost() || session || code != kDone) return code;
  write_out(stderr, "haptrace: the results could not be written to standard output: no room is left there\n");
  return kBadInput;
}

int run(int argc, char** argv) {
  CLI::App app(kDescription, "haptrace");
  app.footer(kFooter);
  app.set_version_flag("--version", software_name());
  app.set_help_flag("-h,--help", "this page; haptrace VERB --help has each verb's own");
  app.require_subcommand(0, 1);
  app.get_formatter()->column_width(34);

  Output output;
  std::string config;
  std::vector<Verb> verbs{add_devices(app), add_shape(app),   add_record(app),    add_play(app),
                          add_guide(app),   add_run(app),     add_calibrate(app), add_info(app),
                          add_check(app),   add_recover(app), add_convert(app),   add_plot(app),
                          add_report(app),  add_doctor(app),  add_stability(app), add_tradeoff(app)};
  std::vector<std::string> names;
  for (const Verb& verb : verbs) {
    verb.app->allow_extras();
    verb.app->get_formatter()->column_width(34);
    verb.app->add_flag("--json", output.json, "one JSON object on standard output, numbers in SI")->group("Output");
    verb.app->add_flag("-q,--quiet", output.quiet, "no summary and no progress")->group("Output");
    verb.app->add_option("--config", config, "JSON file that may hold any option of this verb; the command line wins")
        ->type_name("FILE.json")
        ->group("Output");
    names.push_back(verb.app->get_name());
  }

  try {
    if (argc > 1 && argv[1][0] != '-' && std::find(names.begin(), names.end(), argv[1]) == names.end())
      throw input_error(fmt::format("unknown verb '{}'{}", argv[1], suggestion(argv[1], names)));
    app.parse(argc, argv);
    for (const Verb& verb : verbs) {
      if (!verb.app->parsed()) continue;
      refuse_extras(*verb.app);
      refuse_empty_values(*verb.app);
      refuse_invalid_texts(*verb.app);
      if (!config.empty()) apply_config(*verb.app, config);
      tell_last_words_with([&output](const std::string& words, ZeroForce zero, int code) {
        std::vector<Warning> warnings{{Warning::Severity::error, "stopped", kNaN, words}};
        if (zero == ZeroForce::failed)
          warnings.push_back({Warning::Severity::error, "force_not_zero", kNaN, describe(zero)});
        (void)report(output, code, words, {{"zero_force", to_string(zero)}, {"warnings", json_of(warnings)}});
      });
      return with_results(verb.run(output), *verb.app);
    }
    write_out(stdout, app.help());
    return kBadInput;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    return report(output, kBadInput, error.what());
  } catch (const Error& error) {
    return report(output, exit_code(error.kind()), error.what());
  } catch (const std::exception& error) {
    return report(output, kStopped, fmt::format("unexpected: {}", error.what()));
  }
}

}  // namespace
}  // namespace haptrace::cli

int main(int argc, char** argv) {
  // A file that took the number of a stream that was closed would be written to by every message.
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) < 0 && ::open("/dev/null", O_RDWR) < 0) return 1;
  haptrace::use_recorded_devices();
  const int code = haptrace::cli::run(argc, argv);
  if (!haptrace::LooseThread::any_given_up()) return code;
  std::fflush(nullptr);
  std::_Exit(code);
}

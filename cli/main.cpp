// haptrace: records hand movements with a force-feedback device, and plays them back.
#include "base/error.h"
#include "base/printable.h"
#include "base/suggest.h"
#include "cli/help.h"
#include "cli/input_options.h"
#include "cli/terminal.h"
#include "cli/verb.h"
#include "control/event_words.h"
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

constexpr const char* kDescription = "Records, plays back and teaches hand movements with force-feedback devices.";

constexpr const char* kFooter =
    "  haptrace shape square --size 80mm --duration 8 -o square.h5\n"
    "  haptrace play square.h5 -d sim:preset=falcon,hand=relaxed --record played.h5\n"
    "  haptrace plot played.h5 -o played.png\n"
    "Exit codes: 0 done; 1 a limit or a fault stopped the session (data kept); 2 bad usage or input; 3 device missing "
    "or lost; 130 interrupted (data kept).";

/// Old options of `stability`, and the sub-commands that replace them.
constexpr std::pair<std::string_view, const char*> kMovedOptions[]{{"--staircase", "staircase"},
                                                                   {"--guidance", "guidance"},
                                                                   {"--ensemble", "ensemble --draws N"},
                                                                   {"--device", "map --device NAME"},
                                                                   {"-d", "map --device NAME"}};

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

/// Rejects extra words. Parsing accepts them, so that this function can suggest the nearest option.
void refuse_extras(const CLI::App& verb) {
  for (const std::string& word : verb.remaining()) {
    if (word.size() > 1 && word[0] == '-') {
      const std::string name = word.substr(0, word.find('='));
      throw input_error(fmt::format("unknown option '{}' of haptrace {}{}", name, full_name(verb),
                                    suggestion(name, option_names(verb))));
    }
    throw input_error(fmt::format("unexpected argument '{}'; see haptrace {} --help", word, full_name(verb)));
  }
}

/// Rejects an unknown option before the verb.
void refuse_early_options(const CLI::App& app, const std::vector<std::string>& words) {
  for (const std::string& word : words) {
    if (word == "--" || !word.starts_with('-')) return;
    const std::string name = word.substr(0, word.find('='));
    if (app.get_option_no_throw(name) == nullptr)
      throw input_error(fmt::format("unknown option '{}'. A verb's options follow the verb; see haptrace --help{}",
                                    name, suggestion(name, option_names(app))));
  }
}

/// Rejects texts that are not UTF-8: texts go into recordings, JSON and reports, which are UTF-8, as are file names.
void refuse_invalid_texts(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options())
    for (const std::string& text : option->results())
      if (const std::size_t at = find_invalid_utf8(text); at != std::string::npos)
        throw input_error(
            fmt::format("{}: '{}' is not valid UTF-8 from byte {}. Type it in a UTF-8 terminal, or rename the file",
                        option->get_name(), printable(text), at + 1));
}

/// Rejects empty names: an empty name is usually a shell variable that is not set. The texts that describe a recording
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
            fmt::format("{} is empty. Give it a value or leave it out (a shell variable may be unset)", name));
  }
}

/// Returns the exit code, changed if a full disk lost the results. A reader that closed its pipe did not want them, and
/// the results of a session are in its file.
int with_results(int code, const CLI::App& verb) {
  const bool session = verb.get_option_no_throw("--device") != nullptr;
  if (!results_lost() || session || code != kDone) return code;
  write_out(stderr, "haptrace: the results could not be written to standard output: no space is left\n");
  return kBadInput;
}

/// Returns the error for a verb without the sub-command that it needs.
Error lacks_experiment(const CLI::App& verb) {
  for (const std::string& word : verb.remaining())
    for (const auto& [option, experiment] : kMovedOptions)
      if (word.substr(0, word.find('=')) == option)
        return input_error(
            fmt::format("{} is a sub-command now: use haptrace {} {}. haptrace help {} lists all sub-commands", option,
                        full_name(verb), experiment, full_name(verb)));
  std::vector<std::string> names;
  for (const CLI::App* inner : verb.get_subcommands([](const CLI::App*) { return true; }))
    names.push_back(inner->get_name());
  const std::string word = verb.remaining().empty() ? "" : verb.remaining().front();
  return input_error(fmt::format("haptrace {} needs one of: {}{}", full_name(verb), fmt::join(names, ", "),
                                 word.empty() || word[0] == '-' ? "" : suggestion(word, names)));
}

/// Declares every verb, in the order of the help page.
std::vector<Verb> add_verbs(CLI::App& app) {
  std::vector<Verb> verbs;
  const auto group = [&](const char* name, const std::vector<Verb>& added) {
    for (const Verb& verb : added) {
      CLI::App* top = verb.app;
      while (top->get_parent() != &app) top = top->get_parent();
      top->group(name);
      verbs.push_back(verb);
    }
  };
  group("Sessions", {add_record(app), add_play(app), add_guide(app), add_run(app), add_calibrate(app)});
  group("Recordings", {add_view(app), add_info(app), add_check(app), add_plot(app), add_report(app), add_convert(app),
                       add_recover(app)});
  group("Paths, scenes and devices",
        {add_shape(app), add_average(app), add_scene(app), add_devices(app), add_doctor(app)});
  group("Experiments on simulated devices", {add_tradeoff(app)});
  group("Experiments on simulated devices", add_stability(app));
  group("The command", add_completion(app));
  return verbs;
}

/// Returns the words of the command line; `help VERB` becomes `VERB --help`.
std::vector<std::string> words_of(int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc);
  if (words.empty() || words.front() != "help") return words;
  while (!words.empty() && words.front() == "help") words.erase(words.begin());
  words.emplace_back("--help");
  return words;
}

int run(int argc, char** argv) {
  CLI::App app(kDescription, "haptrace");
  app.formatter(std::make_shared<HelpPage>());
  app.footer(kFooter);
  app.set_version_flag("--version", software_name(), "print the version");
  app.set_help_flag("-h,--help", "print this page");
  app.set_help_all_flag("--help-all", "print every option");
  app.require_subcommand(0, 1);

  Output output;
  std::string config;
  const std::vector<Verb> verbs = add_verbs(app);
  std::vector<std::string> names;
  for (CLI::App* top : app.get_subcommands([](const CLI::App*) { return true; })) {
    top->allow_extras();
    names.push_back(top->get_name());
  }
  for (const Verb& verb : verbs) {
    verb.app->allow_extras();
    accept_units(*verb.app);
    if (verb.app->get_name() == "completion") continue;  // prints one text, which has no other form
    verb.app->add_flag("--json", output.json, "print one JSON object with numbers in SI units")->group("Output");
    verb.app->add_flag("-q,--quiet", output.quiet, "print no summary and no progress")->group("Output");
    verb.app->add_option("--config", config, "read options from this JSON file (the command line takes precedence)")
        ->type_name("FILE.json")
        ->group("Output");
  }

  try {
    std::vector<std::string> words = words_of(argc, argv);
    refuse_early_options(app, words);
    if (!words.empty() && words[0][0] != '-' && std::find(names.begin(), names.end(), words[0]) == names.end())
      throw input_error(fmt::format("unknown verb '{}'{}", words[0], suggestion(words[0], names)));
    std::reverse(words.begin(), words.end());
    app.parse(words);
    for (const Verb& verb : verbs) {
      if (!verb.app->parsed()) continue;
      refuse_extras(*verb.app);
      refuse_empty_values(*verb.app);
      refuse_invalid_texts(*verb.app);
      if (!config.empty()) apply_config(*verb.app, config);
      tell_last_words_with([&output](const std::string& last_words, ZeroForce zero, int code) {
        std::vector<Warning> warnings{{Severity::problem, "stopped", kNaN, last_words}};
        if (zero == ZeroForce::failed) warnings.push_back({Severity::problem, "force_not_zero", kNaN, describe(zero)});
        (void)report(output, code, last_words, {{"zero_force", to_string(zero)}, {"warnings", json_of(warnings)}});
      });
      return with_results(verb.run(output), *verb.app);
    }
    for (const CLI::App* top : app.get_subcommands()) throw lacks_experiment(*top);
    write_out(stdout, app.help());
    return kBadInput;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    return report(output, kBadInput, explained(error));
  } catch (const Error& error) {
    return report(output, exit_code(error.kind()), error.what());
  } catch (const std::exception& error) {
    return report(output, kStopped, fmt::format("unexpected error: {}", error.what()));
  }
}

}  // namespace
}  // namespace haptrace::cli

int main(int argc, char** argv) {
  // If a standard stream were closed, a file could get its number, and every message would be written to that file.
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) < 0 && ::open("/dev/null", O_RDWR) < 0) return 1;
  haptrace::use_recorded_devices();
  const int code = haptrace::cli::run(argc, argv);
  if (!haptrace::LooseThread::any_given_up()) return code;
  std::fflush(nullptr);
  std::_Exit(code);
}

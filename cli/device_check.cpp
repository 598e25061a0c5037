#include "cli/device_check.h"

#include "base/error.h"
#include "base/printable.h"
#include "cli/terminal.h"
#include "devices/check/conformance.h"

#include <cstdio>
#include <fmt/format.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace haptrace::cli {

struct DeviceCheck::Arguments {
  bool wanted = false, yes = false;
  double max_force = ConformanceOptions{}.max_force, rate_hz = ConformanceOptions{}.rate_hz;
};

namespace {

/// Asks the user at the terminal, if there is one.
class TerminalUser final : public ConformanceUser {
 public:
  TerminalUser(const Output& output, bool yes, StopRequest& stop)
      : shown_(!output.json && !output.quiet), yes_(yes), stop_(stop) {}

  [[nodiscard]] bool is_there() const override { return isatty(STDIN_FILENO) != 0 && !yes_; }

  bool allows(const std::string& force) override {
    const std::string line =
        ask(fmt::format("next: {}\n", force), "      Enter sends it, s skips it, q ends the test: ");
    if (!is_there()) return yes_ && stop_.count() == 0;
    if (line == "q") stop_.raise();
    return line.empty() && stop_.count() == 0;
  }

  bool does(const std::string& request) override {
    const std::string line = ask(fmt::format("next: {}\n", request), "      Enter continues, q ends the test: ");
    if (line == "q") stop_.raise();
    return is_there() && stop_.count() == 0;
  }

  std::optional<bool> answers(const std::string& question) override {
    if (!is_there()) return std::nullopt;
    const std::string line = ask("", fmt::format("      {} y or n: ", question));
    if (line == "y" || line == "n") return line == "y";
    return std::nullopt;
  }

  void found(const LawFinding& finding) override {
    if (!shown_) return;
    const char* const verdicts[] = {"passed", "FAILED", "not tested"};
    write_out(stdout, fmt::format("{:<10}  {:<12}  {}: {}\n", verdicts[static_cast<std::size_t>(finding.verdict)],
                                  printable(finding.id), printable(finding.law), printable(finding.detail)));
  }

 private:
  /// Returns the line that the user types; empty without a user, q at the end of the input. Discards anything typed
  /// before the question.
  [[nodiscard]] std::string ask(const std::string& words, const std::string& prompt) const {
    const bool waits = is_there();
    if (waits) tcflush(STDIN_FILENO, TCIFLUSH);
    write_out(stderr, words + (waits ? prompt : ""));
    if (!waits) return "";
    std::string line;
    while (stop_.count() == 0) {
      pollfd input{STDIN_FILENO, POLLIN, 0};
      if (poll(&input, 1, 100) <= 0) continue;
      char c = 0;
      if (read(STDIN_FILENO, &c, 1) != 1) return "q";
      if (c == '\n') return line;
      line += c;
    }
    return "q";
  }

  bool shown_, yes_;
  StopRequest& stop_;
};

nlohmann::json to_json(const ConformanceReport& report) {
  nlohmann::json findings = nlohmann::json::array();
  for (const LawFinding& finding : report.findings) {
    nlohmann::json figures = nlohmann::json::array();
    for (const auto& figure : finding.figures)
      figures.push_back({{"name", figure.name}, {"value", figure.value}, {"unit", figure.unit}});
    findings.push_back({{"id", finding.id},
                        {"law", finding.law},
                        {"verdict", to_string(finding.verdict)},
                        {"detail", finding.detail},
                        {"figures", std::move(figures)}});
  }
  return {{"device", report.device.name},
          {"model", report.device.model},
          {"serial", report.device.serial},
          {"kept", report.kept()},
          {"interrupted", report.interrupted},
          {"zero_force", to_string(report.zero_force)},
          {"passed", report.count(LawFinding::Verdict::passed)},
          {"failed", report.count(LawFinding::Verdict::failed)},
          {"not_tested", report.count(LawFinding::Verdict::not_tested)},
          {"findings", std::move(findings)}};
}

}  // namespace

DeviceCheck::DeviceCheck(CLI::App& devices) : arguments_(std::make_shared<Arguments>()) {
  Arguments& arguments = *arguments_;
  CLI::Option* const test =
      devices.add_flag("--test", arguments.wanted, "test the device against the rules of every driver")->group("Test");
  devices.add_option("--max-force", arguments.max_force, "largest force of the test [N]")
      ->capture_default_str()
      ->needs(test)
      ->group("Test");
  devices.add_option("--rate", arguments.rate_hz, "servo rate [Hz]")->capture_default_str()->needs(test)->group("Test");
  devices.add_flag("-y,--yes", arguments.yes, "send test forces without asking; required without a terminal")
      ->needs(test)
      ->group("Test");
}

bool DeviceCheck::wanted() const {
  return arguments_->wanted;
}

int DeviceCheck::run(const std::string& device, const Output& output) const {
  if (device.empty()) throw input_error("--test needs a device: haptrace devices --test NAME[:key=value,...]");
  const Signals signals;
  StopRequest stop(&signals.stop());
  TerminalUser user(output, arguments_->yes, stop);
  ConformanceOptions options{.rate_hz = arguments_->rate_hz, .max_force = arguments_->max_force};
  if (!user.is_there() && !arguments_->yes)
    options.no_forces = "without a terminal to confirm forces, none is sent; allow all forces with --yes";
  const ConformanceReport report = test_conformance([&device] { return open_device(device); }, options, user, stop);

  const int failed = report.count(LawFinding::Verdict::failed);
  output.tell(to_json(report), fmt::format("{}: {}; {} passed, {} failed, {} not tested\n", report.device.name,
                                           failed > 0           ? "breaks a law"
                                           : report.interrupted ? "interrupted"
                                                                : "keeps every law that was tested",
                                           report.count(LawFinding::Verdict::passed), failed,
                                           report.count(LawFinding::Verdict::not_tested)));
  if (report.zero_force == ZeroForce::failed) {
    output.fault(describe(report.zero_force));
    return kNoDevice;
  }
  if (report.interrupted) return kInterrupted;
  return failed > 0 ? kStopped : kDone;
}

}  // namespace haptrace::cli

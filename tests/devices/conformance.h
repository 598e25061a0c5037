// What the tests that test a device's conformance share.
#pragma once

#include "devices/check/conformance.h"

#include <algorithm>
#include <string>
#include <vector>

namespace haptrace::test {

/// Allows everything, is not there, and remembers what it was told.
class ConsentingUser : public ConformanceUser {
 public:
  bool consents = true;
  std::vector<std::string> refused;      ///< what a force that is refused has in its words
  std::vector<std::string> asked, told;  ///< forces; findings, by id

  [[nodiscard]] bool is_there() const override { return false; }
  bool allows(const std::string& force) override {
    asked.push_back(force);
    return consents && std::none_of(refused.begin(), refused.end(),
                                    [&](const std::string& words) { return force.find(words) != std::string::npos; });
  }
  bool does(const std::string& /*request*/) override { return false; }
  std::optional<bool> answers(const std::string& /*question*/) override { return std::nullopt; }
  void found(const LawFinding& finding) override { told.push_back(finding.id); }
};

/// As short as tells anything, and on a machine that runs other tests.
inline ConformanceOptions hasty_options() {
  return {.rest = 0.3, .busy_machine = true, .realtime = false};
}

/// What was found, a line each.
inline std::string describe(const ConformanceReport& report) {
  std::string text = report.device.name + "\n";
  for (const LawFinding& finding : report.findings)
    text += std::string(to_string(finding.verdict)) + " " + finding.id + ": " + finding.detail + "\n";
  return text;
}

}  // namespace haptrace::test

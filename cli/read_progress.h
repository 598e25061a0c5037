// Progress of reading a long file, or of a long computation.
#pragma once

#include "cli/verb.h"

#include <chrono>
#include <cstdint>
#include <string>
#include <thread>

namespace haptrace::cli {

/// A line on standard error, if that is a terminal, that appears after a moment. The destructor removes it.
class ReadProgress {
 public:
  /// `file` names the file or the computation. `rows` is the length of the file; 0: unknown.
  ReadProgress(const Output& output, std::string file, std::uint64_t rows = 0);
  ~ReadProgress();
  ReadProgress(const ReadProgress&) = delete;
  ReadProgress& operator=(const ReadProgress&) = delete;

  void tell(std::uint64_t rows_done);
  void tell_share(double done, const std::string& note = "");  ///< share from 0 to 1, and an additional note

  /// Return the same as functions, which must not outlive this object.
  [[nodiscard]] auto callback() {
    return [this](std::uint64_t rows_done) { tell(rows_done); };
  }
  [[nodiscard]] auto share_callback() {
    return [this](double done) { tell_share(done); };
  }

 private:
  bool due();

  std::string file_;
  std::uint64_t rows_;
  bool shown_, told_ = false;
  std::chrono::steady_clock::time_point next_;
};

/// A line on standard error, if that is a terminal, for a step whose share that is done is not known: it states the
/// step and its seconds so far. It appears after a moment, and is shown by a thread of its own. Nothing else may be
/// printed during its lifetime; the destructor removes it. It is silent with --quiet and --json.
class WaitingLine {
 public:
  /// `step` names what takes its time, for example "reading scene.json".
  WaitingLine(const Output& output, const std::string& step);

 private:
  std::jthread thread_;
};

}  // namespace haptrace::cli

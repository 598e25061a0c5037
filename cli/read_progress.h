// How far a verb is with reading a long file, or with a long computation.
#pragma once

#include "cli/verb.h"

#include <chrono>
#include <cstdint>
#include <string>

namespace haptrace::cli {

/// A line on standard error, if that is a terminal, once it takes longer than a moment; gone with its owner.
class ReadProgress {
 public:
  /// `file`: what is being read or done. `rows` of the file; 0: unknown.
  ReadProgress(const Output& output, std::string file, std::uint64_t rows = 0);
  ~ReadProgress();
  ReadProgress(const ReadProgress&) = delete;
  ReadProgress& operator=(const ReadProgress&) = delete;

  void tell(std::uint64_t rows_done);
  void tell_share(double done, const std::string& note = "");  ///< 0 to 1, and what else there is to say

  /// The same as functions, which must not outlive this.
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

}  // namespace haptrace::cli

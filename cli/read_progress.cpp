#include "cli/read_progress.h"

#include "base/printable.h"
#include "cli/terminal.h"

#include <condition_variable>
#include <cstdio>
#include <fmt/format.h>
#include <mutex>
#include <stop_token>
#include <unistd.h>

namespace haptrace::cli {
namespace {

constexpr auto kPatience = std::chrono::milliseconds(300);
constexpr auto kPeriod = std::chrono::milliseconds(100);

/// Shows the line of a WaitingLine until `stop`.
void wait_for(const std::string& step, const std::stop_token& stop) {
  using std::chrono::seconds, std::chrono::steady_clock;
  const steady_clock::time_point start = steady_clock::now();
  std::mutex mutex;
  std::condition_variable_any wake;
  std::unique_lock lock(mutex);
  bool told = false;
  const auto stopped = [&] { return stop.stop_requested(); };
  for (auto next = start + kPatience; !wake.wait_until(lock, stop, next, stopped); next += seconds(1)) {
    const auto so_far = std::chrono::round<seconds>(steady_clock::now() - start);
    show_line({{0, step}, {1, so_far.count() > 0 ? fmt::format("{} s", so_far.count()) : ""}});
    told = true;
  }
  if (told) clear_line();
}

}  // namespace

ReadProgress::ReadProgress(const Output& output, std::string file, std::uint64_t rows)
    : file_(std::move(file)),
      rows_(rows),
      shown_(!output.quiet && isatty(STDERR_FILENO) != 0),
      next_(std::chrono::steady_clock::now() + kPatience) {}

ReadProgress::~ReadProgress() {
  if (told_) clear_line();
}

bool ReadProgress::due() {
  const auto now = std::chrono::steady_clock::now();
  if (!shown_ || now < next_) return false;
  next_ = now + kPeriod;
  told_ = true;
  return true;
}

void ReadProgress::tell(std::uint64_t rows_done) {
  if (!due()) return;
  const std::string share =
      rows_ > 0 ? fmt::format(" ({:.0f} %)", 100 * static_cast<double>(rows_done) / static_cast<double>(rows_)) : "";
  show_line({{1, printable(file_) + ":"},
             {0, fmt::format("{:.1f} million samples read{}", 1e-6 * static_cast<double>(rows_done), share)}});
}

void ReadProgress::tell_share(double done, const std::string& note) {
  if (!due()) return;
  show_line({{3, meter(done)}, {0, fmt::format("{:3.0f} %", 100 * done)}, {1, printable(file_)}, {2, note}});
}

WaitingLine::WaitingLine(const Output& output, const std::string& step) {
  if (output.quiet || output.json || isatty(STDERR_FILENO) == 0) return;
  thread_ = std::jthread([step = printable(step)](const std::stop_token& stop) { wait_for(step, stop); });
}

}  // namespace haptrace::cli

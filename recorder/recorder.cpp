#include "recorder/recorder.h"

#include "control/error.h"

#include <algorithm>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

namespace haptrace {
namespace {

constexpr std::size_t kSmallestRing = 16384;  // rows: in virtual time the loop runs far ahead of the writer
constexpr std::size_t kEventRing = 1024;
constexpr double kChunkSpan = 2;  // of the session's time in a chunk at most: slow sessions make small files [s]
constexpr std::size_t kLargestBatch = 1024;  // rows
constexpr auto kPoll = std::chrono::milliseconds(5);

std::size_t rows_in(double seconds, double rate_hz, std::size_t least) {
  return std::max(least, static_cast<std::size_t>(std::ceil(seconds * rate_hz)));
}

}  // namespace

struct Recorder::Writer {
  Writer(const std::string& name, const RecordingHeader& header, const RecordingColumns& columns,
         const Options& options)
      : file(name),
        flush_period(options.flush_period),
        samples(rows_in(options.ring_seconds, header.rate_hz, kSmallestRing)),
        events(kEventRing),
        output(name, header, columns,
               {.overwrite = options.overwrite,
                .storage = {.rows_per_chunk = std::min(rows_in(kChunkSpan, header.rate_hz, 64), std::size_t{2048})}}),
        thread([this](const std::stop_token& stop) { run(stop); }) {}

  /// Until asked to stop, and then until the rings are empty.
  void run(const std::stop_token& stop) {
    try {
      auto flushed = std::chrono::steady_clock::now();
      for (bool last = false; !last;) {
        const bool stopping = stop.stop_requested();
        const bool wrote = drain();
        last = stopping && !wrote;
        const auto now = std::chrono::steady_clock::now();
        if (std::chrono::duration<double>(now - flushed).count() >= flush_period) {
          output.flush();
          flushed = now;
        }
        if (!wrote && !last) std::this_thread::sleep_for(kPoll);
      }
    } catch (...) {
      error = std::current_exception();
      failed.store(true, std::memory_order_release);
    }
  }

  bool drain() {
    bool wrote = false;
    while (batch.size() < kLargestBatch &&
           samples.consume_one([&](const Sample& sample) { batch.push_back(sample); })) {
    }
    if (!batch.empty()) {
      output.append(batch);
      written.fetch_add(batch.size(), std::memory_order_relaxed);
      last_time_ns = batch.back().time_ns;
      batch.clear();
      wrote = true;
    }
    events.consume_all([&](const Event& event) {
      append(event);
      wrote = true;
    });
    const std::uint64_t lost_now = lost.load(std::memory_order_relaxed);
    if (lost_now > lost_told) {
      append({.time_ns = last_time_ns,
              .code = EventCode::samples_lost,
              .values = {static_cast<double>(lost_now - lost_told), kNaN, kNaN}});
      lost_told = lost_now;
    }
    return wrote;
  }

  void append(const Event& event) {
    output.append(StoredEvent{.time = 1e-9 * static_cast<double>(event.time_ns),
                              .code = static_cast<std::int32_t>(event.code),
                              .text = describe(event)});
  }

  void stop() {
    if (!thread.joinable()) return;
    thread.request_stop();
    thread.join();
  }

  std::string file;
  double flush_period;  ///< [s]
  boost::lockfree::spsc_queue<Sample> samples;
  boost::lockfree::spsc_queue<Event> events;
  std::atomic<std::uint64_t> written{0}, lost{0};
  std::atomic<bool> failed{false};

  // The writer thread's own.
  RecordingWriter output;
  std::vector<Sample> batch;
  std::uint64_t lost_told = 0;
  std::int64_t last_time_ns = 0;
  std::exception_ptr error;  ///< read after join

  std::jthread thread;  ///< last, so that it starts when everything else is there
};

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
                   const Options& options)
    : writer_(std::make_unique<Writer>(file, header, columns, options)) {}

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns)
    : Recorder(file, header, columns, Options{}) {}

Recorder::~Recorder() {
  abandon();
}

void Recorder::push(const Sample& sample) noexcept {
  if (!writer_->samples.push(sample)) writer_->lost.fetch_add(1, std::memory_order_relaxed);
}

void Recorder::push(const Event& event) noexcept {
  if (!writer_->events.push(event)) writer_->lost.fetch_add(1, std::memory_order_relaxed);
}

void Recorder::between_ticks(bool may_wait) noexcept {
  if (!may_wait) return;
  while (writer_->samples.write_available() == 0 && !writer_->failed.load(std::memory_order_acquire))
    std::this_thread::sleep_for(std::chrono::microseconds(100));
}

void Recorder::finish() {
  writer_->stop();
  if (writer_->error) {
    writer_->output.abandon();
    std::rethrow_exception(std::exchange(writer_->error, nullptr));
  }
  writer_->output.finish();
}

void Recorder::abandon() noexcept {
  writer_->stop();
  writer_->output.abandon();
}

Recorder::Status Recorder::status() const noexcept {
  return {writer_->written.load(std::memory_order_relaxed), writer_->lost.load(std::memory_order_relaxed),
          writer_->failed.load(std::memory_order_acquire)};
}

const std::string& Recorder::file() const noexcept {
  return writer_->file;
}

}  // namespace haptrace

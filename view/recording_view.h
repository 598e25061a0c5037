// The view of recordings: a server for pages in a browser on this machine (docs/view-protocol.md).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// Shows one recording, or the recordings of a session in order, to pages. Opening costs the same for any length: what
/// a page asks for is read in a thread of its own.
///
/// Threads: all functions from one thread.
class RecordingView {
 public:
  struct Options {
    std::uint16_t port = 0;  ///< 0: any free port
  };

  /// Opens the first file and listens on 127.0.0.1 and ::1. Throws Error(input): there is no file, the first one cannot
  /// be read, or the port is taken.
  RecordingView(std::vector<std::string> files, const Options& options);

  /// Closes all pages.
  ~RecordingView();
  RecordingView(const RecordingView&) = delete;
  RecordingView& operator=(const RecordingView&) = delete;

  /// Returns the address to open, with its token.
  [[nodiscard]] std::string address() const;

  /// Waits until a page has shown its token. Returns false after `patience`.
  bool wait_for_page(std::chrono::milliseconds patience);

  /// Returns the number of pages that have shown their token. From any thread.
  [[nodiscard]] std::size_t pages() const;

 private:
  class Shelf;
  std::unique_ptr<Shelf> shelf_;
};

}  // namespace haptrace

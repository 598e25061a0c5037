// A Falcon's link with a scripted device at its other end.
#pragma once

#include "base/error.h"
#include "devices/falcon/link.h"
#include "devices/falcon/protocol.h"

#include <algorithm>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace haptrace::test {

using Bytes = std::vector<std::uint8_t>;

/// The script of the links: records the writes and holds the answers. It outlives its links. Time stands still: a read
/// without data returns at once, as if it had waited.
struct FalconScript {
  std::function<void(const Bytes&)> on_write = [](const Bytes&) {};
  std::function<void(FalconLink::Request, std::uint16_t)> on_control = [](FalconLink::Request, std::uint16_t) {};
  std::deque<Bytes> line;  ///< incoming data, one element per read
  std::vector<Bytes> written;
  int opened = 0, closed = 0;
  bool takes = true, gone = false;

  void say(const FalconBytes& bytes) { line.emplace_back(bytes.begin(), bytes.end()); }

  std::unique_ptr<FalconLink> open();
};

class ScriptedLink final : public FalconLink {
 public:
  explicit ScriptedLink(FalconScript& script) : script_(script) { ++script_.opened; }
  ~ScriptedLink() override { close(); }

  void control(Request request, std::uint16_t value) override {
    expect_here();
    script_.on_control(request, value);
  }
  bool write(std::span<const std::uint8_t> bytes, double /*timeout*/) override {
    expect_here();
    if (!script_.takes) return false;
    script_.written.emplace_back(bytes.begin(), bytes.end());
    script_.on_write(script_.written.back());
    return true;
  }
  std::size_t read(std::span<std::uint8_t> bytes, double /*timeout*/) override {
    expect_here();
    if (script_.line.empty()) return 0;
    const Bytes next = std::exchange(script_.line.front(), {});
    script_.line.pop_front();
    std::copy(next.begin(), next.end(), bytes.begin());
    return next.size();
  }
  void close() noexcept override {
    if (!std::exchange(closed_, true)) ++script_.closed;
  }

 private:
  void expect_here() const {
    if (script_.gone || closed_) throw device_error("it was unplugged");
  }

  FalconScript& script_;
  bool closed_ = false;
};

inline std::unique_ptr<FalconLink> FalconScript::open() {
  return std::make_unique<ScriptedLink>(*this);
}

}  // namespace haptrace::test

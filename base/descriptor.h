// A file descriptor that closes itself.
#pragma once

#include <unistd.h>
#include <utility>

namespace haptrace {

/// Owns a file descriptor and closes it. A negative value means that there is none.
class Descriptor {
 public:
  explicit Descriptor(int opened = -1) noexcept : value_(opened) {}
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }

  [[nodiscard]] int get() const noexcept { return value_; }
  [[nodiscard]] explicit operator bool() const noexcept { return value_ >= 0; }

 private:
  int value_;
};

}  // namespace haptrace

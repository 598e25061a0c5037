#include "devices/falcon/firmware.h"

#include "base/error.h"
#include "devices/falcon/dialogue.h"
#include "devices/loop/clock.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <iterator>
#include <span>

namespace haptrace {
namespace {

using FalconByteSpan = std::span<const std::uint8_t>;
using Request = FalconLink::Request;

constexpr std::uint16_t kPurgeReceiver = 1, kPurgeSender = 2;
constexpr std::uint16_t kDtrLow = 0x0100, kDtrHigh = 0x0101, kRtsLow = 0x0200;
constexpr std::uint16_t kEightBitsNoParity = 8, kNoFlowControl = 0;
constexpr std::uint16_t kBaud9600 = 0x4138, kBaudOfLoader = 0x0015, kBaudOfRun = 0x0002;  // 3 MHz / 21, 1.5 MBd
constexpr std::uint16_t kLatencyOfLoader = 16, kLatencyOfRun = 1;  // [ms]; greetings fail at the shorter one

constexpr std::array<std::uint8_t, 3> kGreeting{0x0a, 0x43, 0x0d};
constexpr std::array<std::uint8_t, 4> kWelcome{0x0a, 0x44, 0x2c, 0x0d};  // a 0 may precede it
constexpr std::array<std::uint8_t, 1> kBegin{0x41};
constexpr std::size_t kChunk = 62;  // the echo of a chunk and the chip's status are one USB packet

constexpr int kLoadingTries = 10, kGreetings = 50;
constexpr int kProbes = 200;            // to firmware that may just have started: 1 s in all
constexpr double kGreetingTime = 0.04;  // [s], like the next two
constexpr double kEchoTime = 0.5;
constexpr double kSilence = 0.03;  // silence after which no more bytes are expected

void falcon_send(FalconLink& link, FalconByteSpan bytes) {
  if (!link.write(bytes, kEchoTime)) throw device_error("its USB chip accepts no data");
}

/// Returns the bytes that come within `timeout` [s], or until `enough` accepts them.
template <class Enough>
std::vector<std::uint8_t> falcon_hear(FalconLink& link, double timeout, Enough enough) {
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(1e9 * timeout);
  std::vector<std::uint8_t> heard;
  for (double left = timeout; left > 0 && !enough(heard); left = 1e-9 * static_cast<double>(end_ns - monotonic_ns())) {
    std::array<std::uint8_t, 256> bytes{};
    const std::size_t count = link.read(bytes, left);
    if (count == 0) break;
    heard.insert(heard.end(), bytes.data(), bytes.data() + count);
  }
  return heard;
}

void falcon_await_silence(FalconLink& link) {
  std::array<std::uint8_t, 256> bytes{};
  for (int reads = 0; reads < 100 && link.read(bytes, kSilence) > 0; ++reads) {
  }
}

void falcon_purge(FalconLink& link) {
  link.control(Request::purge, kPurgeReceiver);
  link.control(Request::purge, kPurgeSender);
}

std::string falcon_hex(FalconByteSpan bytes) {
  constexpr std::size_t kMost = 8;
  if (bytes.empty()) return "nothing";
  return fmt::format("{:02x}{}", fmt::join(bytes.first(std::min(kMost, bytes.size())), " "),
                     bytes.size() > kMost ? " ..." : "");
}

void greet_falcon_loader(FalconLink& link) {
  const auto is_welcome = [](FalconByteSpan heard) {
    return heard.size() >= kWelcome.size() && std::ranges::equal(heard.last(kWelcome.size()), kWelcome);
  };
  std::vector<std::uint8_t> heard, last;
  for (int greetings = 0; greetings < kGreetings; ++greetings) {
    falcon_send(link, kGreeting);
    heard = falcon_hear(link, kGreetingTime, is_welcome);
    if (is_welcome(heard)) return;
    if (!heard.empty()) last = heard;
  }
  throw device_error(fmt::format("its loader answered {} to the greeting", falcon_hex(last)));
}

void send_falcon_image(FalconLink& link, FalconByteSpan image) {
  for (std::size_t sent = 0; sent < image.size(); sent += kChunk) {
    const FalconByteSpan chunk = image.subspan(sent, std::min(kChunk, image.size() - sent));
    falcon_send(link, chunk);
    const auto echo = falcon_hear(link, kEchoTime, [&](FalconByteSpan heard) { return heard.size() >= chunk.size(); });
    const auto [wrong, returned] = std::mismatch(chunk.begin(), chunk.end(), echo.begin(), echo.end());
    if (wrong != chunk.end()) {
      const auto place = sent + static_cast<std::size_t>(wrong - chunk.begin());
      throw device_error(returned == echo.end()
                             ? fmt::format("after {} of {} bytes, its loader stopped answering", place, image.size())
                             : fmt::format("byte {} of {} was sent as {:02x} and came back as {:02x}", place + 1,
                                           image.size(), *wrong, *returned));
    }
    if (echo.size() > chunk.size())
      throw device_error(fmt::format("more bytes came back than were sent, after {} of {} bytes", sent, image.size()));
  }
}

void load_falcon_firmware(FalconLink& link, FalconByteSpan image) {
  falcon_purge(link);
  link.control(Request::latency_timer, kLatencyOfLoader);
  link.control(Request::baud, kBaud9600);
  link.control(Request::line, kEightBitsNoParity);
  link.control(Request::flow, kNoFlowControl);
  link.control(Request::modem, kRtsLow);
  link.control(Request::modem, kDtrLow);
  link.control(Request::modem, kDtrHigh);
  greet_falcon_loader(link);

  link.control(Request::modem, kDtrLow);
  link.control(Request::baud, kBaudOfLoader);
  falcon_await_silence(link);  // answers to earlier greetings
  falcon_send(link, kBegin);
  const auto heard = falcon_hear(link, kEchoTime, [](FalconByteSpan bytes) { return !bytes.empty(); });
  if (!std::ranges::equal(heard, kBegin))
    throw device_error(fmt::format("its loader answered {} to the start command", falcon_hex(heard)));
  send_falcon_image(link, image);
}

void set_falcon_running(FalconLink& link) {
  falcon_purge(link);
  link.control(Request::latency_timer, kLatencyOfRun);
  link.control(Request::baud, kBaudOfRun);
  falcon_purge(link);
}

/// Returns whether firmware answers packets that request no force.
bool falcon_runs(FalconLink& link) {
  FalconDialogue dialogue(link);
  for (int probes = 0; probes < kProbes; ++probes) {
    if (!dialogue.ask({})) continue;
    falcon_await_silence(link);
    return true;
  }
  return false;
}

/// Collects the reasons of failed tries, and merges equal consecutive ones.
class FalconFailures {
 public:
  void add(const std::string& why) {
    ++tries_;
    if (runs_.empty() || runs_.back().why != why) runs_.push_back({tries_, tries_, why});
    runs_.back().last = tries_;
  }
  [[nodiscard]] std::string text() const {
    std::vector<std::string> texts;
    for (const auto& [first, last, why] : runs_)
      texts.push_back(first == last ? fmt::format("try {}: {}", first, why)
                                    : fmt::format("tries {} to {}: {}", first, last, why));
    return fmt::format("{}", fmt::join(texts, "; "));
  }

 private:
  struct Run {
    int first, last;
    std::string why;
  };
  int tries_ = 0;
  std::vector<Run> runs_;
};

}  // namespace

FalconFirmware read_falcon_firmware(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error))
    throw input_error(
        fmt::format("{}: there is no such file; set firmware=FILE to a file with a Falcon's firmware", file));
  const auto size = std::filesystem::file_size(file, error);
  if (error || size < FalconFirmware::kLeast || size > FalconFirmware::kMost)
    throw input_error(
        fmt::format("{}: the file has {} bytes; a Falcon's firmware has 7 to 9 kB", file, error ? 0 : size));
  std::ifstream stream(file, std::ios::binary);
  FalconFirmware firmware{.file = file, .image = {std::istreambuf_iterator<char>(stream), {}}};
  if (!stream || firmware.image.size() != size) throw input_error(fmt::format("{}: the file cannot be read", file));
  return firmware;
}

std::unique_ptr<FalconLink> start_falcon(const OpenFalconLink& open, const std::optional<FalconFirmware>& firmware) {
  std::unique_ptr<FalconLink> link = open();
  set_falcon_running(*link);
  if (falcon_runs(*link)) return link;
  if (!firmware)
    throw device_error(
        "no firmware runs on the Falcon, which is normal after it is switched on, and no firmware file is given. Use "
        "falcon:firmware=FILE. The sources of libnifalcon contain such a file, firmware/nvent_firmware.bin; Novint's "
        "licence does not allow haptrace to include it");

  FalconFailures failures;
  for (int tries = 0; tries < kLoadingTries; ++tries) {
    try {
      if (link == nullptr) link = open();
      load_falcon_firmware(*link, firmware->image);
      set_falcon_running(*link);
      if (falcon_runs(*link)) return link;
      failures.add("the firmware was loaded, but it does not answer");
    } catch (const Error& error) {
      failures.add(error.what());
    }
    link.reset();
  }
  throw device_error(
      fmt::format("{}: the firmware could not be loaded into the Falcon in {} tries ({}). Switch its power off and on. "
                  "Then try another USB port, without a hub or with a hub that has its own power supply",
                  firmware->file, kLoadingTries, failures.text()));
}

}  // namespace haptrace

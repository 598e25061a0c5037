#include "devices/falcon/emulated_falcon.h"

#include "base/error.h"
#include "base/number.h"
#include "base/suggest.h"
#include "control/path/min_jerk.h"
#include "devices/falcon/kinematics.h"
#include "devices/falcon/protocol.h"
#include "devices/loop/clock.h"
#include "devices/sim/noise.h"

#include <algorithm>
#include <deque>
#include <fmt/format.h>
#include <map>
#include <mutex>
#include <utility>

namespace haptrace {
namespace {

constexpr std::int64_t kFalconStep = 1'000'000;                               // longest step of the mechanism [ns]
constexpr std::int64_t kFalconLongestLeap = 100'000'000;                      // [ns]; longer times pass without motion
constexpr double kBitsPerByte = 10;                                           // including start and stop bit
constexpr double kAskSpeed = 9600, kLoadSpeed = 3e6 / 21, kRunSpeed = 1.5e6;  // baud rates of the board
constexpr double kSpeedTolerance = 0.03;
constexpr std::array<std::uint8_t, 3> kQuestion{0x0a, 0x43, 0x0d};
constexpr std::array<std::uint8_t, 4> kReply{0x0a, 0x44, 0x2c, 0x0d};
constexpr std::uint8_t kBeginLoading = 0x41;
constexpr std::array<std::uint8_t, EmulatedFalcon::kStatus> kChipStatus{0x01, 0x60};  // idle, all sent
constexpr std::size_t kPayload = EmulatedFalcon::kPacket - EmulatedFalcon::kStatus;
constexpr std::int64_t kLatencyAtFirst = 16'000'000;  // [ns]
constexpr int kMostCounts = 2000;                     // largest offset of an encoder that is not homed
constexpr double kHomingReach = 0.02;                 // homing movement to either side of the marks [m]
constexpr int kHalvings = 20;                         // bisection steps in the search for a stop
// Distance from the stops to the limit of the legs' reach, relative to the distance from the origin to the stops.
constexpr double kStopMargin = 0.02;
constexpr double kHomingPart = 0.15;  // duration of each homing movement: out, in, back [s]

bool is_speed(double baud, double expected) {
  return std::abs(baud / expected - 1) < kSpeedTolerance;
}

bool happens(SplitMix64& random, double chance) {
  return chance > 0 && random.between(0, 1) < chance;
}

struct FalconFaultKind {
  const char* name;
  const char* numbers;  ///< syntax of the numbers
  double fallback;      ///< default of the first number; NaN: it is required
  double least, most;   ///< range of the first number
  void (*set)(FalconFaults& faults, double first, double second);
};

constexpr double kLongestFaultTime = 1e6;  // [s]

constexpr FalconFaultKind kFalconFaults[] = {
    {"unplug", ":AT[:FOR]", kNaN, 0, kLongestFaultTime,
     [](FalconFaults& f, double at, double lasts) {
       f.unplugged = {at, lasts};
     }},
    {"power", ":AT[:FOR]", kNaN, 0, kLongestFaultTime,
     [](FalconFaults& f, double at, double lasts) {
       f.unpowered = {at, lasts};
     }},
    {"stall", ":AT", kNaN, 0, kLongestFaultTime, [](FalconFaults& f, double at, double) { f.stalls = at; }},
    {"hang", ":AT", kNaN, 0, kLongestFaultTime, [](FalconFaults& f, double at, double) { f.hangs = at; }},
    {"silent", ":AT", kNaN, 0, kLongestFaultTime, [](FalconFaults& f, double at, double) { f.silent = at; }},
    {"frozen", ":AT", kNaN, 0, kLongestFaultTime, [](FalconFaults& f, double at, double) { f.frozen = at; }},
    {"lost", "[:CHANCE]", 1e-3, 0, 1, [](FalconFaults& f, double chance, double) { f.lost = chance; }},
    {"garbage", "[:CHANCE]", 1e-3, 0, 1, [](FalconFaults& f, double chance, double) { f.garbage = chance; }},
    {"flipped", "[:CHANCE]", 1e-3, 0, 1, [](FalconFaults& f, double chance, double) { f.flipped = chance; }},
    {"bad_echo", "[:TIMES]", 1, 1, 1e6,
     [](FalconFaults& f, double times, double) { f.bad_echoes = static_cast<int>(times); }},
    {"bad_start", "[:TIMES]", 5, 1, 1e6,
     [](FalconFaults& f, double times, double) { f.bad_starts = static_cast<int>(times); }},
    {"slow_chip", "", 0, 0, 0, [](FalconFaults& f, double, double) { f.slow_chip = true; }},
    {"unhomed", "[:LEG]", 1, 1, 3, [](FalconFaults& f, double leg, double) { f.unhomed = static_cast<int>(leg); }},
};

const FalconFaultKind& falcon_fault_kind(std::string_view name, const std::string& where) {
  std::vector<std::string> names;
  for (const auto& kind : kFalconFaults) {
    if (kind.name == name) return kind;
    names.emplace_back(kind.name);
  }
  throw input_error(fmt::format("{}: there is no fault '{}'{}", where, name, suggestion(name, names)));
}

/// Removes the text up to and including `separator`, and returns it without `separator`.
std::string_view take_part(std::string_view& text, char separator) {
  const auto end = std::min(text.find(separator), text.size());
  const std::string_view part = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return part;
}

void read_falcon_fault(std::string_view text, const std::string& where, FalconFaults& faults) {
  std::string_view rest = text;
  const FalconFaultKind& kind = falcon_fault_kind(take_part(rest, ':'), where);
  const bool has_two = std::string_view(kind.numbers).find("FOR") != std::string_view::npos;
  double numbers[2] = {kind.fallback, FalconFaults::kNever};
  const std::size_t most = has_two ? 2 : *kind.numbers != '\0' ? 1 : 0;
  std::size_t count = 0;
  bool right = text.back() != ':';
  for (; right && !rest.empty(); ++count) {
    const std::string_view part = take_part(rest, ':');
    const auto number = number_of<double>(part);
    const double low = count == 0 ? kind.least : 0, high = count == 0 ? kind.most : kLongestFaultTime;
    right = count < most && number && *number >= low && *number <= high;
    if (right) numbers[count] = *number;
  }
  if (!right || std::isnan(numbers[0]))
    throw input_error(
        fmt::format("{}: '{}': expected {}{}, with numbers in SI units{}", where, text, kind.name, kind.numbers,
                    kind.most > 0 ? fmt::format(", the first from {:g} to {:g}", kind.least, kind.most) : ""));
  kind.set(faults, numbers[0], numbers[1]);
}

}  // namespace

FalconFaults FalconFaults::parse(std::string_view text, const std::string& where) {
  FalconFaults faults;
  std::string_view rest = text;
  bool more = true;
  while (more) {
    more = rest.find('+') != std::string_view::npos;
    const std::string_view part = take_part(rest, '+');
    read_falcon_fault(part.empty() ? std::string_view(" ") : part, where, faults);
  }
  return faults;
}

std::string FalconFaults::help() {
  std::vector<std::string> names;
  for (const auto& kind : kFalconFaults) names.push_back(std::string(kind.name) + kind.numbers);
  return fmt::format("faults to emulate, joined by '+': {}", fmt::join(names, ", "));
}

/// One direction of the serial line: bytes, and the time at which each arrives.
class EmulatedFalcon::Line {
 public:
  void set_speed(double baud) noexcept { byte_ns_ = std::llround(1e9 * kBitsPerByte / baud); }
  void send(std::uint8_t byte, std::int64_t now_ns) {
    free_ns_ = std::max(free_ns_, now_ns) + byte_ns_;
    bytes_.push_back({byte, free_ns_});
  }
  void clear() noexcept {
    bytes_.clear();
    free_ns_ = 0;
  }

  /// Takes the oldest byte that has arrived. Returns false if there is none.
  [[nodiscard]] bool take(std::uint8_t& byte, std::int64_t& at_ns, std::int64_t now_ns) {
    if (bytes_.empty() || bytes_.front().at_ns > now_ns) return false;
    byte = bytes_.front().byte;
    at_ns = bytes_.front().at_ns;
    bytes_.pop_front();
    return true;
  }

  /// Returns when the `count`-th byte arrives; the largest time if it was not sent yet.
  [[nodiscard]] std::int64_t arrival_of(std::size_t count) const noexcept {
    return count == 0 || count > bytes_.size() ? std::numeric_limits<std::int64_t>::max() : bytes_[count - 1].at_ns;
  }
  [[nodiscard]] std::size_t size() const noexcept { return bytes_.size(); }

 private:
  struct Byte {
    std::uint8_t byte;
    std::int64_t at_ns;
  };
  std::deque<Byte> bytes_;
  std::int64_t byte_ns_ = 0, free_ns_ = 0;
};

/// Legs and motors on the plant, and the simulated user who homes them.
class EmulatedFalcon::Mechanism {
 public:
  Mechanism(const FalconCalibration& calibration, LivePlant plant)
      : calibration_(calibration), kinematics_(calibration.geometry), plant_(std::move(plant)) {
    plant_.advance_to(0);
    const auto marks = kinematics_.at_angles(calibration.home_angle);
    marks_ = marks ? Vec3(marks->position - calibration.origin) : Vec3::Zero();
    const auto middle = kinematics_.at_position(calibration.origin);
    if (!middle) throw input_error("the legs of the emulated Falcon do not reach the origin of its workspace");
    pose_ = *middle;
    hold(held_by());
  }

  void advance(std::int64_t step_ns, const std::array<std::int16_t, 3>& motors) {
    if (user_ns_ >= 0) user_ns_ += step_ns;
    if (user_ns_ >= 3 * kPart) user_ns_ = -1;
    plant_.apply(force_);
    plant_ns_ += step_ns;
    plant_.advance_to(plant_ns_);
    hold(held_by());
    force_ = pose_.jacobian.transpose().inverse() * torques(motors);
  }

  /// Lets the simulated user take the handle, unless the user already holds it.
  void ask_for_homing() noexcept {
    if (user_ns_ >= 0) return;
    user_ns_ = 0;
    taken_at_ = plant_.position();
  }

  [[nodiscard]] Vec3 position() const noexcept { return pose_.position - calibration_.origin; }
  [[nodiscard]] const Vec3& angles() const noexcept { return pose_.angles; }
  [[nodiscard]] const Vec3& force() const noexcept { return force_; }

 private:
  static constexpr std::int64_t kPart = static_cast<std::int64_t>(1e9 * kHomingPart);

  /// Returns the position that the plant or the user demands of the handle [m].
  [[nodiscard]] Vec3 held_by() const noexcept {
    if (user_ns_ < 0) return plant_.position();
    const Vec3 reach(0, 0, kHomingReach), marks = marks_ - taken_at_;
    const Vec3 way[] = {Vec3::Zero(), marks + reach, marks - reach, Vec3::Zero()};
    const std::int64_t part = std::min<std::int64_t>(user_ns_ / kPart, 2);
    const double s = MinJerk::at(static_cast<double>(user_ns_ - part * kPart) / static_cast<double>(kPart)).s;
    return plant_.position() + way[part] + s * (way[part + 1] - way[part]);
  }

  /// Returns the pose with the handle at `place` [m]; none beyond the stops.
  [[nodiscard]] std::optional<FalconPose> pose_at(const Vec3& place) const noexcept {
    if (!kinematics_.at_position(calibration_.origin + (1 + kStopMargin) * place)) return std::nullopt;
    return kinematics_.at_position(calibration_.origin + place);
  }

  /// Moves the handle to `place`, or from the origin towards it as far as the stops allow.
  void hold(const Vec3& place) noexcept {
    double near = 0, far = 1;
    if (const auto pose = pose_at(place)) {
      pose_ = *pose;
      return;
    }
    for (int halving = 0; halving < kHalvings; ++halving) {
      const double middle = 0.5 * (near + far);
      const auto pose = pose_at(middle * place);
      if (pose) pose_ = *pose;
      (pose ? near : far) = middle;
    }
  }

  [[nodiscard]] Vec3 torques(const std::array<std::int16_t, 3>& motors) const noexcept {
    Vec3 counts(motors[0], motors[1], motors[2]);
    counts = counts.cwiseMax(-calibration_.max_motor_counts).cwiseMin(calibration_.max_motor_counts);
    return calibration_.motor_sign.cwiseProduct(counts).cwiseQuotient(calibration_.counts_per_n_m);
  }

  FalconCalibration calibration_;
  FalconKinematics kinematics_;
  LivePlant plant_;
  std::int64_t plant_ns_ = 0;
  Vec3 marks_;                 ///< position where all legs pass their marks, in W [m]
  std::int64_t user_ns_ = -1;  ///< time since the user took the handle; negative: not held
  Vec3 taken_at_ = Vec3::Zero();
  FalconPose pose_;
  Vec3 force_ = Vec3::Zero();
};

/// The board at the other end of the serial line: the boot loader, then the firmware.
class EmulatedFalcon::Board {
 public:
  Board(const FalconCalibration& calibration, Start start, const FalconFaults& faults, std::uint64_t seed,
        const Vec3& angles)
      : calibration_(calibration), faults_(faults), random_(seed, 11), angles_(angles) {
    restart(Stage::asleep);
    if (start != Start::switched_on) stage_ = Stage::running;
    if (start == Start::homed)
      for (int leg = 0; leg < 3; ++leg) home(leg);
  }

  void set_power(bool on) {
    if (on == (stage_ == Stage::off)) restart(on ? Stage::asleep : Stage::off);
  }

  void set_data_terminal_ready(bool high) {
    if (high && !data_terminal_ready_ && stage_ != Stage::off) restart(Stage::listening);
    data_terminal_ready_ = high;
  }

  /// Notes that the host sends at `baud` from now on. At kRunSpeed, loaded firmware starts.
  void set_speed(double baud) {
    if (stage_ != Stage::loading || loaded_ == 0 || !is_speed(baud, kRunSpeed)) return;
    if (loadings_ > faults_.bad_starts)
      stage_ = Stage::running;
    else
      restart(Stage::asleep);
  }

  /// Takes a byte that came at `baud` and `age`, and appends the answer to `answer`.
  void receive(std::uint8_t byte, double baud, double age, std::vector<std::uint8_t>& answer) {
    switch (stage_) {
      case Stage::off:
      case Stage::asleep:
        return;
      case Stage::listening:
        if (!is_speed(baud, kAskSpeed)) return;
        asked_ = byte == kQuestion[asked_] ? asked_ + 1 : byte == kQuestion[0] ? 1 : 0;
        if (asked_ < kQuestion.size()) return;
        asked_ = 0;
        answer.assign(kReply.begin(), kReply.end());
        stage_ = Stage::greeted;
        return;
      case Stage::greeted:
        if (!is_speed(baud, kLoadSpeed)) return;
        if (byte != kBeginLoading || data_terminal_ready_) return;
        answer.push_back(byte);
        ++loadings_;
        stage_ = Stage::loading;
        return;
      case Stage::loading:
        if (!is_speed(baud, kLoadSpeed)) return;
        answer.push_back(loaded_ == 0 && loadings_ <= faults_.bad_echoes ? static_cast<std::uint8_t>(~byte) : byte);
        ++loaded_;
        return;
      case Stage::running:
        if (!is_speed(baud, kRunSpeed)) return;
        if (const auto packet = decoder_.push(byte)) take(*packet, age, answer);
        return;
    }
  }

  /// Takes the new angles of the legs. A leg that passes its mark in either direction is homed, but only while homing
  /// is requested.
  void see(const Vec3& angles) noexcept {
    for (int leg = 0; leg < 3; ++leg) {
      const double before = angles_[leg] - calibration_.home_angle[leg];
      const double after = angles[leg] - calibration_.home_angle[leg];
      if (asks_for_homing() && before * after <= 0 && leg + 1 != faults_.unhomed) home(leg);
    }
    angles_ = angles;
  }

  void stop_motors() noexcept { motors_ = {}; }
  void press(std::uint8_t buttons) noexcept { buttons_ = buttons & 0xf; }

  [[nodiscard]] bool runs() const noexcept { return stage_ == Stage::running; }
  [[nodiscard]] bool asks_for_homing() const noexcept {
    return runs() && (flags_ & calibration_.homing_flag) != 0 && !is_homed();
  }
  [[nodiscard]] bool is_homed() const noexcept { return homed_ == 7; }
  [[nodiscard]] int loadings() const noexcept { return loadings_; }
  [[nodiscard]] std::uint64_t packets() const noexcept { return packets_; }
  [[nodiscard]] const std::array<std::int16_t, 3>& motors() const noexcept { return motors_; }
  [[nodiscard]] std::uint8_t flags() const noexcept { return flags_; }

 private:
  enum class Stage : std::uint8_t { off, asleep, listening, greeted, loading, running };

  /// Restarts in `stage` and forgets firmware, flags and homing.
  void restart(Stage stage) {
    stage_ = stage;
    asked_ = loaded_ = 0;
    homed_ = flags_ = 0;
    stop_motors();
    decoder_.reset();
    for (int& offset : offsets_) offset = static_cast<int>(random_.between(-kMostCounts, kMostCounts));
  }

  void home(int leg) noexcept {
    homed_ |= static_cast<std::uint8_t>(1 << leg);
    offsets_[static_cast<std::size_t>(leg)] = 0;
  }

  void take(const FalconPacket& packet, double age, std::vector<std::uint8_t>& answer) {
    ++packets_;
    motors_ = packet.words;
    flags_ = packet.flags;
    if (age >= faults_.silent) return;
    if (age < faults_.frozen) read_encoders();
    const FalconBytes bytes = encode({encoders_, static_cast<std::uint8_t>(buttons_ | homed_ << 4)});
    for (std::uint8_t byte : bytes) {
      if (happens(random_, faults_.lost)) continue;
      if (happens(random_, faults_.flipped)) byte ^= static_cast<std::uint8_t>(1U << random_.next() % 8);
      answer.push_back(byte);
      if (happens(random_, faults_.garbage)) answer.push_back(static_cast<std::uint8_t>(random_.next()));
    }
  }

  void read_encoders() noexcept {
    const Vec3 counts = (angles_ - calibration_.home_angle)
                            .cwiseProduct(calibration_.encoder_sign)
                            .cwiseProduct(calibration_.counts_per_rad);
    for (std::size_t leg = 0; leg < 3; ++leg)
      encoders_[leg] = static_cast<std::int16_t>(std::lround(counts[static_cast<int>(leg)]) + offsets_[leg]);
  }

  FalconCalibration calibration_;
  const FalconFaults& faults_;  ///< may change at any time
  SplitMix64 random_;
  Stage stage_ = Stage::asleep;
  bool data_terminal_ready_ = false;
  std::size_t asked_ = 0, loaded_ = 0;  ///< bytes received of the question and of the firmware
  int loadings_ = 0;
  std::uint64_t packets_ = 0;
  FalconDecoder decoder_;
  std::array<std::int16_t, 3> motors_{}, encoders_{};
  std::uint8_t flags_ = 0, buttons_ = 0, homed_ = 0;
  std::array<int, 3> offsets_{};  ///< offsets of encoders that are not homed [counts]
  Vec3 angles_;
};

EmulatedFalcon::EmulatedFalcon(const FalconCalibration& calibration, LivePlant plant, Start start,
                               const FalconFaults& faults, std::uint64_t seed)
    : faults_(faults),
      mechanism_(std::make_unique<Mechanism>(calibration, std::move(plant))),
      board_(std::make_unique<Board>(calibration, start, faults_, seed, mechanism_->angles())),
      from_host_(std::make_unique<Line>()),
      to_host_(std::make_unique<Line>()) {
  reset_chip();
}

EmulatedFalcon::~EmulatedFalcon() = default;

EmulatedFalcon::Handshake EmulatedFalcon::control(std::uint8_t request, std::uint16_t value, std::int64_t now_ns) {
  advance_to(now_ns);
  if (!is_there()) return Handshake::gone;
  if (age() >= faults_.hangs) return Handshake::later;
  using Request = FalconLink::Request;
  switch (static_cast<Request>(request)) {
    case Request::purge:
      if (value != 2) to_host_->clear();
      if (value != 1) from_host_->clear();
      return Handshake::ok;
    case Request::modem:
      set_modem(value);
      return Handshake::ok;
    case Request::flow:
      return Handshake::ok;
    case Request::baud:
      set_baud(value);
      return Handshake::ok;
    case Request::line:
      eight_bits_ = value == 8;
      return Handshake::ok;
    case Request::latency_timer:
      if (!faults_.slow_chip) latency_ns_ = std::clamp<std::int64_t>(value, 1, 255) * 1'000'000;
      return Handshake::ok;
  }
  return Handshake::stalled;
}

/// Advances to `now_ns` and returns the state of an endpoint, regardless of data.
EmulatedFalcon::Handshake EmulatedFalcon::endpoint(bool& halted, std::int64_t now_ns) {
  advance_to(now_ns);
  if (!is_there()) return Handshake::gone;
  if (age() >= faults_.hangs) return Handshake::later;
  if (age() >= faults_.stalls && !has_stalled_) in_halted_ = out_halted_ = has_stalled_ = true;
  return halted ? Handshake::stalled : Handshake::ok;
}

EmulatedFalcon::Handshake EmulatedFalcon::out(std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  const Handshake handshake = endpoint(out_halted_, now_ns);
  if (handshake != Handshake::ok) return handshake;
  for (const std::uint8_t byte : bytes) from_host_->send(byte, now_ns);
  return Handshake::ok;
}

EmulatedFalcon::Handshake EmulatedFalcon::in(std::array<std::uint8_t, kPacket>& packet, std::size_t& size,
                                             std::int64_t now_ns) {
  const Handshake handshake = endpoint(in_halted_, now_ns);
  if (handshake != Handshake::ok) return handshake;
  if (to_host_->arrival_of(kPayload) > now_ns && now_ns < last_in_ns_ + latency_ns_) return Handshake::later;
  std::copy(kChipStatus.begin(), kChipStatus.end(), packet.begin());
  size = kStatus;
  std::int64_t at_ns = 0;
  while (size < packet.size() && to_host_->take(packet[size], at_ns, now_ns)) ++size;
  last_in_ns_ = now_ns;
  return Handshake::ok;
}

std::int64_t EmulatedFalcon::next_in() const noexcept {
  if (age() >= faults_.hangs) return now_ns_ + kFalconStep;
  return std::min(
      {last_in_ns_ + latency_ns_, to_host_->arrival_of(kPayload), from_host_->arrival_of(from_host_->size())});
}

void EmulatedFalcon::unplug(std::int64_t now_ns) {
  advance_to(now_ns);
  pulled_ = true;
  board_->stop_motors();
}

void EmulatedFalcon::plug_in(std::int64_t now_ns) {
  advance_to(now_ns);
  pulled_ = false;
  reset_chip();
}

void EmulatedFalcon::press(std::uint8_t buttons) noexcept {
  board_->press(buttons);
}

void EmulatedFalcon::advance_to(std::int64_t now_ns) {
  if (begin_ns_ < 0) begin_ns_ = now_ns_ = last_in_ns_ = now_ns;
  std::uint8_t byte = 0;
  std::int64_t at_ns = 0;
  std::vector<std::uint8_t> answer;
  while (from_host_->take(byte, at_ns, now_ns)) {
    live_until(at_ns);
    if (eight_bits_) board_->receive(byte, baud_, age(), answer);
    for (const std::uint8_t one : answer) to_host_->send(one, at_ns);
    answer.clear();
  }
  live_until(now_ns);
}

void EmulatedFalcon::live_until(std::int64_t now_ns) {
  now_ns_ = std::max(now_ns_, now_ns - kFalconLongestLeap);
  while (now_ns_ < now_ns) {
    const std::int64_t step_ns = std::min(kFalconStep, now_ns - now_ns_);
    now_ns_ += step_ns;
    board_->set_power(!faults_.unpowered.covers(age()));
    const bool slips = faults_.unplugged.covers(age());
    if (slips != slipped_) reset_chip();
    slipped_ = slips;
    if (!is_there()) board_->stop_motors();
    if (board_->asks_for_homing()) mechanism_->ask_for_homing();
    mechanism_->advance(step_ns, board_->motors());
    board_->see(mechanism_->angles());
  }
}

/// Sets the baud rate as FTDI's chips divide 3 MHz: 14 bits integer part, 2 bits fraction.
void EmulatedFalcon::set_baud(std::uint16_t divisor) noexcept {
  constexpr double kFractions[] = {0, 0.5, 0.25, 0.125};
  const double division = (divisor & 0x3fff) + kFractions[divisor >> 14];
  baud_ = 3e6 / (divisor == 0 ? 1 : divisor == 1 ? 1.5 : std::max(division, 1.0));
  from_host_->set_speed(baud_);
  to_host_->set_speed(baud_);
  board_->set_speed(baud_);
}

/// Sets the modem lines: the high byte selects lines, the low byte holds their levels.
void EmulatedFalcon::set_modem(std::uint16_t lines) noexcept {
  if ((lines & 0x0100) != 0) board_->set_data_terminal_ready((lines & 0x0001) != 0);
}

void EmulatedFalcon::reset_chip() noexcept {
  from_host_->clear();
  to_host_->clear();
  baud_ = kAskSpeed;
  from_host_->set_speed(baud_);
  to_host_->set_speed(baud_);
  eight_bits_ = true;
  latency_ns_ = kLatencyAtFirst;
  in_halted_ = out_halted_ = false;
}

bool EmulatedFalcon::runs() const noexcept {
  return board_->runs();
}
bool EmulatedFalcon::is_homed() const noexcept {
  return board_->is_homed();
}
int EmulatedFalcon::loadings() const noexcept {
  return board_->loadings();
}
std::uint64_t EmulatedFalcon::packets() const noexcept {
  return board_->packets();
}
std::array<std::int16_t, 3> EmulatedFalcon::motors() const noexcept {
  return board_->motors();
}
std::uint8_t EmulatedFalcon::flags() const noexcept {
  return board_->flags();
}
Vec3 EmulatedFalcon::force() const noexcept {
  return mechanism_->force();
}
Vec3 EmulatedFalcon::position() const noexcept {
  return mechanism_->position();
}

namespace {

std::int64_t falcon_deadline(double timeout) {
  return monotonic_ns() + static_cast<std::int64_t>(1e9 * timeout);
}

class EmulatedFalconLink final : public FalconLink {
 public:
  explicit EmulatedFalconLink(std::shared_ptr<EmulatedFalcon> falcon) : falcon_(std::move(falcon)) {}

  void control(Request request, std::uint16_t value) override {
    const auto handshake = falcon().control(static_cast<std::uint8_t>(request), value, monotonic_ns());
    if (handshake == Handshake::later)
      throw device_error("the emulated Falcon's USB chip hangs; open the device again");
    check(handshake);
    if (request == Request::purge) first_ = end_ = 0;
  }

  bool write(std::span<const std::uint8_t> bytes, double timeout) override {
    const std::int64_t deadline = falcon_deadline(timeout);
    while (!bytes.empty()) {
      const auto packet = bytes.first(std::min(bytes.size(), EmulatedFalcon::kPacket));
      const Handshake handshake = falcon().out(packet, monotonic_ns());
      check(handshake);
      if (handshake == Handshake::ok) {
        bytes = bytes.subspan(packet.size());
      } else if (!sleep_until_next(deadline)) {
        return false;
      }
    }
    return true;
  }

  std::size_t read(std::span<std::uint8_t> bytes, double timeout) override {
    const std::int64_t deadline = falcon_deadline(timeout);
    do {
      if (first_ == end_) fetch();
      const std::size_t count = std::min(bytes.size(), end_ - first_);
      std::copy_n(packet_.begin() + static_cast<std::ptrdiff_t>(first_), count, bytes.begin());
      first_ += count;
      if (count > 0) return count;
    } while (sleep_until_next(deadline));
    return 0;
  }

  void close() noexcept override { falcon_.reset(); }

 private:
  using Handshake = EmulatedFalcon::Handshake;

  [[nodiscard]] EmulatedFalcon& falcon() {
    if (!falcon_) throw device_error("the link to the emulated Falcon is closed");
    return *falcon_;
  }

  static void check(Handshake handshake) {
    if (handshake == Handshake::gone)
      throw device_error("the emulated Falcon's USB cable is unplugged; wait until it is plugged in again");
    if (handshake == Handshake::stalled)
      throw device_error("the emulated Falcon's USB chip has stalled; open the device again");
  }

  /// Fetches the next packet, if there is one, into the empty buffer.
  void fetch() {
    std::size_t size = EmulatedFalcon::kStatus;
    check(falcon().in(packet_, size, monotonic_ns()));
    first_ = EmulatedFalcon::kStatus;
    end_ = size;
  }

  /// Waits until a packet may come. Returns false if that is after `deadline`.
  [[nodiscard]] bool sleep_until_next(std::int64_t deadline) {
    const std::int64_t next = std::max(falcon().next_in(), monotonic_ns());
    MonotonicClock().wait_until(std::min(next, deadline));
    return next <= deadline;
  }

  std::shared_ptr<EmulatedFalcon> falcon_;
  std::array<std::uint8_t, EmulatedFalcon::kPacket> packet_{};
  std::size_t first_ = 0, end_ = 0;  ///< unread range of packet_
};

std::shared_ptr<EmulatedFalcon> make_emulated_falcon(const DeviceSpec& device, const FalconCalibration& calibration,
                                                     const FalconFaults& faults) {
  const bool loads = faults.bad_echoes > 0 || faults.bad_starts > 0;
  const auto seed = device.number<std::uint64_t>("seed", 0, std::numeric_limits<std::uint64_t>::max(), 1);
  return std::make_shared<EmulatedFalcon>(calibration, open_live_plant(device, "falcon"),
                                          loads ? EmulatedFalcon::Start::switched_on : EmulatedFalcon::Start::loaded,
                                          faults, seed);
}

/// Returns the Falcon with this text that loses its cable or power supply. It is kept, so that it loses them once and
/// not at every opening.
std::shared_ptr<EmulatedFalcon>& lasting_falcon(const std::string& text) {
  static std::mutex mutex;
  static std::map<std::string, std::shared_ptr<EmulatedFalcon>> falcons;
  const std::scoped_lock lock(mutex);
  return falcons[text];
}

}  // namespace

std::unique_ptr<FalconLink> open_emulated_falcon_link(const DeviceSpec& device, const FalconCalibration& calibration) {
  const std::string text = device.option("fault");
  const FalconFaults faults =
      text.empty() ? FalconFaults() : FalconFaults::parse(text, fmt::format("--device '{}': fault", device.text));
  std::shared_ptr<EmulatedFalcon> falcon;
  if (faults.unplugged.at < FalconFaults::kNever || faults.unpowered.at < FalconFaults::kNever) {
    auto& lasting = lasting_falcon(device.text);
    if (!lasting) lasting = make_emulated_falcon(device, calibration, faults);
    if (lasting.use_count() > 1)
      throw device_error(fmt::format("--device '{}': the device is already open; close it first", device.text));
    falcon = lasting;
    falcon->advance_to(monotonic_ns());
    if (!falcon->is_there())
      throw device_error(fmt::format("--device '{}': its USB cable is unplugged; plug it in again", device.text));
  } else {
    falcon = make_emulated_falcon(device, calibration, faults);
  }
  return std::make_unique<EmulatedFalconLink>(std::move(falcon));
}

}  // namespace haptrace

#include "player/tuning/live_session.h"

#include "base/error.h"
#include "base/number.h"
#include "base/printable.h"
#include "base/suggest.h"
#include "base/units.h"
#include "control/event_words.h"
#include "devices/device.h"
#include "player/session.h"
#include "player/supporting_controller.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <utility>

namespace haptrace {
namespace {

constexpr std::size_t kLongestHistory = 1000;  // changes
constexpr std::size_t kMostNotices = 1000;
constexpr std::size_t kLongestText = 120;  // of a mark or a note [bytes]

const std::vector<std::string> kActions{"pause",   "resume", "skip",  "repeat", "mark", "note",  "soften", "stop",
                                        "restore", "get",    "reset", "help",   "quit", "first", "second"};
constexpr const char* kSupport = "support";
constexpr const char* kHelp =
    "support 2 ; pause ; resume ; skip ; repeat ; mark [TEXT] ; note TEXT ; soften ; restore ; stop ; get ; get NAME ; "
    "reset ; "
    "first ; second ; help ; quit";

bool known(const std::string& name, const std::vector<std::string>& names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Splits a line at blanks; * and / are always words of their own. Throws for characters that are not printable ASCII,
/// because commands are echoed to terminals.
std::vector<std::string> words_of(std::string_view line) {
  std::vector<std::string> words;
  bool within = false;
  for (const char c : line) {
    const bool blank = c == ' ' || c == '\t' || c == '\r', sign = c == '*' || c == '/';
    if (!blank && (c < ' ' || c > '~'))
      throw input_error("a command is one line of printable ASCII; help lists the commands");
    if (!blank && (sign || !within)) words.emplace_back();
    if (!blank) words.back() += c;
    within = !blank && !sign;
  }
  if (words.empty()) throw input_error("the line is empty; help lists the commands");
  return words;
}

std::string_view trimmed(std::string_view text) {
  constexpr const char* kBlanks = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

}  // namespace

LiveSession::LiveSession(Options options) : options_(std::move(options)) {}

std::string LiveSession::obey(std::string_view command) {
  try {
    const std::lock_guard lock(mutex_);
    const std::string text = answer(trimmed(command));
    return text.starts_with('{') ? text : "ok " + text;
  } catch (const Error& error) {
    return std::string("error ") + error.what();
  }
}

std::string LiveSession::answer(std::string_view command) {
  // The texts of marks and notes may be in any language. They are not echoed.
  const std::size_t end = std::min(command.find_first_of(" \t"), command.size());
  if (const std::string first(command.substr(0, end)); first == "mark" || first == "note")
    return annotate(first, trimmed(command.substr(end)));

  const std::vector<std::string> words = words_of(command);
  const std::string& name = words.front();
  const Words values = Words(words).subspan(1);
  std::vector<std::string> values_known = quantities();
  values_known.emplace_back(kSupport);
  std::vector<std::string> names = values_known;
  names.insert(names.end(), kActions.begin(), kActions.end());
  if (!known(name, names)) throw input_error(fmt::format("unknown command '{}'{}", name, suggestion(name, names)));
  if (name == "get") {
    if (values.empty()) return whole_state().dump();
    if (values.size() > 1) throw input_error("get takes at most one name, as in get kp");
    if (!known(values[0], values_known))
      throw input_error(fmt::format("unknown name '{}'{}", values[0], suggestion(values[0], values_known)));
    return values[0] == kSupport ? support_text() : text_of(values[0]);
  }
  if (known(name, kActions)) {
    if (!values.empty()) throw input_error(fmt::format("{} takes no value", name));
    return act(name);
  }
  if (name == kSupport) return values.empty() ? support_text() : change_support(values);
  return values.empty() ? text_of(name) : change(name, values);
}

std::string LiveSession::act(const std::string& name) {
  if (name == "help") return fmt::format("{} ; {}", help(), kHelp);
  if (name == "quit") return "bye";
  if (name == "reset") return "reset to " + reset_all();
  if (name == "pause" || name == "resume") return pause(name == "pause");
  if (name == "skip") return skip();
  if (name == "repeat") return repeat();
  if (name == "soften" || name == "restore") return soften(name == "soften");
  if (name == "first" || name == "second") return answer_with(name);
  if (options_.stop == nullptr) throw input_error("stop: this session cannot be stopped by a command; use Ctrl+C");
  if (options_.stop->count() == 0) log("session: stop", "stop", {});
  options_.stop->raise(StopSource::command);
  return "stop: the force fades out and the session ends; another stop ends it at once";
}

std::string LiveSession::pause(bool paused) {
  if (wanted_.paused == paused)
    throw input_error(paused ? "pause: the session is paused already; resume continues it"
                             : "resume: the session is not paused");
  wanted_.paused = paused;
  if (options_.records) {
    if (options_.annotations) paused ? options_.annotations->pause() : options_.annotations->resume();
    return paused ? "pause" : "resume";
  }
  // In a programme, the present repetition comes to its end first.
  post();
  log(paused ? "session: pause" : "session: resume", paused ? "pause" : "resume", {});
  if (!paused) return "resume";
  return options_.programme && trial_ != nullptr ? "pause after this repetition" : "pause";
}

std::string LiveSession::skip() {
  if (options_.records) throw input_error("skip: a recording has no repetitions; mark what to skip");
  if (options_.programme) {
    if (trial_ == nullptr) throw input_error("skip: no repetition is running");
    if (!std::exchange(skipped_, true)) trial_->raise();
  } else {
    ++wanted_.skips;
    post();
  }
  log("session: skip", "skip", {});
  return "skip: this repetition ends";
}

std::string LiveSession::repeat() {
  if (options_.records) throw input_error("repeat: a recording has no repetitions; --count records several trials");
  if (options_.endless) throw input_error("repeat: the session repeats until it is stopped");
  if (options_.programme) {
    if (trial_ == nullptr && recording_.empty()) throw input_error("repeat: no repetition has begun yet");
    if (std::exchange(repeats_, true)) throw input_error("repeat: this repetition is done once more already");
  } else {
    if (wanted_.repeats >= kMostRepeats)
      throw input_error(fmt::format("repeat: a session repeats at most {} times more", kMostRepeats));
    ++wanted_.repeats;
    post();
  }
  log("session: repeat", "repeat", {});
  return "repeat: once more after this repetition";
}

std::string LiveSession::answer_with(const std::string& name) {
  if (!asks_) throw input_error(name + ": there is no question now");
  answered_ = name == "first" ? 1 : 2;  // the session log keeps it; the recording has ended
  return name;
}

int LiveSession::answer_of(bool asking) {
  const std::lock_guard lock(mutex_);
  const int answer = std::exchange(answered_, 0);
  asks_ = asking && answer == 0;
  return answer;
}

std::string LiveSession::soften(bool softened) {
  if (std::exchange(softened_, softened) != softened) {
    post_share();
    log(softened ? "session: soften" : "session: restore", softened ? "soften" : "restore", {});
  }
  return fmt::format("{}: feedback forces at {:.0f} %{}", softened ? "soften" : "restore", 100 * wanted_.share,
                     !softened && !attended_ ? " until the controlling page is back" : "");
}

bool LiveSession::attend(bool attended) {
  const std::lock_guard lock(mutex_);
  if (std::exchange(attended_, attended) == attended) return true;
  unattended_in_trial_ |= !attended && trial_ != nullptr;
  post_share();
  log(attended ? "session: the controlling page is back" : "session: the controlling page is silent, softened",
      attended ? "attended" : "unattended", {});
  return true;
}

void LiveSession::post() {
  SessionRequests posted = wanted_;
  posted.paused = wanted_.paused && !options_.programme;
  requests_.post(posted);
}

void LiveSession::post_share() {
  const double share = softened_ || !attended_ ? kSoftened : 1;
  if (wanted_.share == share) return;
  wanted_.share = share;
  post();
}

const LiveSession::CarriedArm& LiveSession::arm() const {
  if (!arm_)
    throw input_error(fmt::format(
        "{0}: this session began without a support of the arm (--{0}, or \"{0}\" in a programme)", kSupport));
  return *arm_;
}

std::string LiveSession::support_text() const {
  return fmt::format("{} {:.3g}", kSupport, arm().force);
}

void LiveSession::set_support(double wanted) {
  const double force = std::min(wanted, arm_->most);
  if (arm_->force == force) return;
  wanted_.support = arm_->force = force;
  post();
  log_change(kSupport, support_text());
}

double LiveSession::wanted_support(Words values, std::optional<double> present) {
  if (present)
    if (const auto factor = factor_of(kSupport, values)) return *factor * *present;
  std::string text;
  for (const std::string& value : values) text += value;  // "2 N"
  const auto force = parse_quantity(text, "N");
  if (!force || !std::isfinite(*force))
    throw input_error(fmt::format("{0} takes a force, such as 2 or 1.5N{1}", kSupport,
                                  present ? fmt::format(", or a factor as in {} * 1.1", kSupport) : ""));
  if (*force < 0) throw input_error(fmt::format("{} is negative; it must be at least 0", kSupport));
  return *force;
}

std::string LiveSession::change_support(Words values) {
  if (!begun_) return expect_support(values);
  const double asked = wanted_support(values, arm().force);
  set_support(asked);
  supports_[exercise_].changed = arm_->force;
  if (arm_->force == asked) return support_text();
  return fmt::format("{} clamped from {:.3g}: {:.3g} is the {}", support_text(), asked, arm_->force, arm_->because);
}

std::string LiveSession::expect_support(Words values) {
  if (options_.programme) throw input_error(fmt::format("{}: no repetition has begun yet", kSupport));
  const double force = wanted_support(values, std::nullopt);
  supports_[exercise_].changed = force;
  return fmt::format("{} {:.3g} from the beginning, if the session carries an arm", kSupport, force);
}

std::string LiveSession::reset_all() {
  if (!arm_) {
    const std::string values = reset();
    return values.empty() ? "the start" : values;
  }
  ExerciseSupport& support = supports_[exercise_];
  support.changed.reset();
  set_support(support.planned);
  try {
    const std::string others = reset();
    return others.empty() ? support_text() : fmt::format("{} {}", others, support_text());
  } catch (const Error&) {  // the support was all that there is to reset
    return support_text();
  }
}

void LiveSession::begin_support(std::optional<CarriedArm> arm) {
  const std::lock_guard lock(mutex_);
  begun_ = true;
  arm_ = std::move(arm);
  if (arm_ && !options_.programme) {
    ExerciseSupport& support = supports_[exercise_];
    support.planned = arm_->force;
    if (support.changed) arm_->force = std::min(*support.changed, arm_->most);
  }
  wanted_.support = arm_ ? arm_->force : kNaN;
  post();
}

double LiveSession::next_support(std::size_t exercise, double planned) {
  const std::lock_guard lock(mutex_);
  ExerciseSupport& support = supports_[exercise];
  support.planned = planned;
  return support.changed.value_or(planned);
}

std::string LiveSession::annotate(const std::string& name, std::string_view text) {
  if (printable(text) != text)
    throw input_error(fmt::format("{}: the text must be UTF-8 without control characters", name));
  if (text.size() > kLongestText)
    throw input_error(fmt::format("{}: the text has {} bytes; at most {} are kept", name, text.size(), kLongestText));
  const bool note = name == "note";
  if (note && text.empty()) throw input_error("note takes a text, as in note tired");
  const std::string mark = note           ? fmt::format("note: {}", text)
                           : text.empty() ? fmt::format("mark {}", ++marks_)
                                          : std::string(text);
  log(mark, note || text.empty() ? mark : "mark: " + mark, {});
  return name + (options_.annotations ? "" : ": kept in the history only; the session is not recorded");
}

void LiveSession::log_change(const std::string& subject, const std::string& text) {
  log("tuned: " + text, text, subject);
}

void LiveSession::log(const std::string& mark, const std::string& text, const std::string& subject) {
  const std::int64_t now_ns = now_ns_.load(std::memory_order_relaxed);
  if (options_.annotations) options_.annotations->mark(mark);
  add_notice({mark, subject});
  changes_.push_back({now_ns, text, recording_});
  if (changes_.size() > kLongestHistory) changes_.pop_front();
  ++changed_;
}

void LiveSession::add_notice(Notice notice) {
  if (!notices_.empty() && !notice.subject.empty() && notices_.back().subject == notice.subject) notices_.pop_back();
  notices_.push_back(std::move(notice));
  if (notices_.size() > kMostNotices) notices_.pop_front();
}

std::vector<LiveControl> LiveSession::controls() const {
  const std::lock_guard lock(mutex_);
  std::vector<LiveControl> controls = list_controls();
  if (arm_)
    controls.push_back({.name = kSupport,
                        .label = "Support of the arm",
                        .unit = "N",
                        .value = arm_->force,
                        .least = 0,
                        .largest = arm_->most,
                        .step = 0.05 * arm_->most,
                        .because = arm_->because});
  return controls;
}

std::vector<std::string> LiveSession::actions() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> names{wanted_.paused ? "resume" : "pause"};
  if (options_.programme ? trial_ != nullptr && !skipped_ : !options_.records) names.emplace_back("skip");
  const bool repeatable = options_.records     ? false
                          : options_.programme ? !recording_.empty() && !repeats_
                                               : !options_.endless && wanted_.repeats < kMostRepeats;
  if (repeatable) names.emplace_back("repeat");
  if (asks_) names.insert(names.end(), {"first", "second"});
  names.insert(names.end(), {"mark", "note"});
  return names;
}

void LiveSession::tell(std::string notice) {
  const std::lock_guard lock(mutex_);
  add_notice({std::move(notice), {}});
}

bool LiveSession::paused() const {
  const std::lock_guard lock(mutex_);
  return wanted_.paused;
}

bool LiveSession::skips() const {
  const std::lock_guard lock(mutex_);
  return skipped_;  // only in a programme; until the next repetition
}

double LiveSession::share() const {
  const std::lock_guard lock(mutex_);
  return wanted_.share;
}

std::string LiveSession::summary() const {
  const std::lock_guard lock(mutex_);
  const std::string values = summarise();
  return fmt::format("{}{}{}{}{}", wanted_.paused ? "paused " : "", wanted_.share < 1 ? "softened " : "", values,
                     arm_ && !values.empty() ? " " : "", arm_ ? support_text() : "");
}

std::vector<std::string> LiveSession::take_notices() {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> texts;
  for (Notice& notice : notices_) texts.push_back(std::move(notice.text));
  notices_.clear();
  return texts;
}

nlohmann::json LiveSession::whole_state() const {
  nlohmann::json json = state();
  json["paused"] = wanted_.paused;
  json["share"] = wanted_.share;
  if (arm_) {
    json[kSupport] = arm_->force;
    json["limits"][kSupport] = arm_->most;
  }
  return json;
}

nlohmann::json LiveSession::history() const {
  const std::lock_guard lock(mutex_);
  nlohmann::json json = whole_state();
  json["changed"] = changed_;
  json["changes"] = nlohmann::json::array();
  for (const Change& change : changes_) {
    json["changes"].push_back({{"time_s", 1e-9 * static_cast<double>(change.time_ns)}, {"text", change.text}});
    if (!change.recording.empty()) json["changes"].back()["recording"] = change.recording;
  }
  return json;
}

LiveSession::Trial::Trial(LiveSession* session, StopRequest& end, std::string file, std::size_t exercise)
    : session_(session) {
  if (session_ != nullptr) session_->begin_trial(end, std::move(file), exercise);
}

LiveSession::Trial::~Trial() {
  finish();
}

LiveSession::TrialEnd LiveSession::Trial::finish() {
  LiveSession* const session = std::exchange(session_, nullptr);
  return session != nullptr ? session->end_trial() : TrialEnd{};
}

void LiveSession::begin_trial(StopRequest& end, std::string file, std::size_t exercise) {
  const std::lock_guard lock(mutex_);
  trial_ = &end;
  exercise_ = exercise;
  recording_ = std::move(file);
  skipped_ = repeats_ = false;
  unattended_in_trial_ = !attended_;
  now_ns_.store(0, std::memory_order_relaxed);
}

LiveSession::TrialEnd LiveSession::end_trial() {
  const std::lock_guard lock(mutex_);
  trial_ = nullptr;
  return {.skipped = skipped_, .unattended = unattended_in_trial_};
}

bool LiveSession::take_repeat() {
  const std::lock_guard lock(mutex_);
  return std::exchange(repeats_, false);
}

double LiveSession::finite_number(const std::string& name, const std::string& text) {
  const auto value = number_of<double>(text);
  if (!value || !std::isfinite(*value)) throw input_error(fmt::format("{}: '{}' is not a number", name, text));
  return *value;
}

std::optional<double> LiveSession::factor_of(const std::string& name, Words values) {
  const bool divides = !values.empty() && values[0] == "/";
  if (values.size() != 2 || (values[0] != "*" && !divides)) return std::nullopt;
  const double number = finite_number(name, values[1]);
  const double factor = divides ? 1 / number : number;
  if (!(number > 0 && factor > 0 && std::isfinite(factor)))
    throw input_error(fmt::format("{}: the factor must be above 0", name));
  return factor;
}

void attach(LiveSession& live, const DeviceInfo& device, SessionOptions& session, std::vector<SampleSink*>& sinks) {
  if (session.support.acts()) {
    const SupportPlan plan = plan_support(device, session);
    live.begin_support(LiveSession::CarriedArm{plan.support.force, plan.most, plan.because});
  } else {
    live.begin_support(std::nullopt);
  }
  session.touch.requests = &live.requests();
  session.also_warn([&live] { return known_warnings(Severity::note, "tuning", live.take_notices()); });
  sinks.push_back(&live);
}

}  // namespace haptrace

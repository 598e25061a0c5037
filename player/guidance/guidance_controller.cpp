#include "player/guidance/guidance_controller.h"

#include "base/error.h"
#include "control/norm.h"
#include "control/path/arc_path.h"
#include "control/resistance_timer.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr double kLongestCursorStep = 5;  // largest step of the cursor [ticks]
constexpr double kCursorPause = 0.2;      // time in which a cursor stops or resumes its speed [s]

double approach_limit(const GuidanceOptions& options) noexcept {
  return options.max_approach_deviation.value_or(options.max_deviation);
}

}  // namespace

GuidanceController::GuidanceController(std::shared_ptr<const ArcPath> path, Guidance guidance, const PdGains& approach,
                                       const GuidanceOptions& options)
    : path_(std::move(path)),
      guidance_(std::move(guidance)),
      approach_gains_(approach),
      options_(options),
      tracker_(*path_, {.allow_back = options.allow_back, .resolution = options.resolution}) {
  validate(options);
  haptrace::validate(approach);
}

void GuidanceController::obey(Mailbox<SessionRequests>& requests, Mailbox<GuideTuning>& tunings) noexcept {
  mailbox_ = &requests;
  tunings_ = &tunings;
}

void GuidanceController::start(const State& first) noexcept {
  requests_ = RequestFollower(mailbox_);
  if (tunings_ != nullptr) {
    GuideTuning tuning = tunings_->latest();
    tuning.share = requests_.paused() ? 0 : requests_.wanted_share();
    guidance_.tune(tuning, true);
  }
  begin_approach(first.position);
}

void GuidanceController::resume(const State& first) noexcept {
  guidance_.begin();
  blend_ = Ramp(0);
  hand_.reset();
  begin_approach(first.position);
}

void GuidanceController::begin_approach(const Vec3& from) noexcept {
  phases_.begin_approach(from, path_->position_at(0));
}

bool GuidanceController::arrived() const noexcept {
  if (options_.cursor) return tracker_.foot().s >= path_->length();
  return is_at_end(tracker_.foot().s, path_->length()) && tracker_.foot().certainty > 0 &&
         walked_length_ >= kWalked * path_->length();
}

bool GuidanceController::may_begin(const Vec3& position) const noexcept {
  const bool is_there = norm_of(position - path_->position_at(0)) <= options_.max_deviation;
  return options_.led || is_there || (options_.time_limit > 0 && phases_.elapsed() >= options_.time_limit);
}

void GuidanceController::watch_deviation(double deviation, Command& command) const noexcept {
  const double limit = phases_.phase() == Phase::approach ? approach_limit(options_) : options_.max_deviation;
  if (deviation <= limit) return;
  command.status = Command::Status::deviation;
  command.event = Event{.code = EventCode::deviation_limit, .values = {deviation, limit, kNaN}};
}

bool GuidanceController::Lasting::update(bool is, double dt, double time) noexcept {
  const double before = std::exchange(now, is ? now + dt : 0);
  if (is) total += dt;
  return before < time && now >= time;
}

void GuidanceController::watch_forces(const State& state, Command& command) noexcept {
  run_time_ += state.dt;
  const PlaceTracker::Foot& foot = tracker_.foot();
  const double share = guidance_.tank().share();
  if (doubt_.update(foot.certainty < kFaded, state.dt, kDoubtLasts) && !command.event)
    command.event = Event{.code = EventCode::place_in_doubt, .values = {doubt_.now, foot.s, tracker_.rival()}};
  if (empty_.update(guidance_.is_active() && share < kFaded, state.dt, kEmptyLasts) && !command.event)
    command.event = Event{.code = EventCode::tank_empty, .values = {empty_.now, share, kNaN}};
}

bool GuidanceController::follow_requests(const State& state) noexcept {
  requests_.update(state.dt);
  phases_.add(requests_.take_repeats());
  if (requests_.take_skip()) phases_.skip();
  const bool was_paused = std::exchange(paused_, requests_.paused());
  GuideTuning target = tunings_ != nullptr ? tunings_->latest() : GuideTuning{};
  target.share = paused_ ? 0 : requests_.wanted_share();
  guidance_.tune(target);
  if (was_paused && !paused_) {
    // No force has led the hand meanwhile. The law must not pull it from afar.
    const bool near = norm_of(state.position - tracker_.foot().place.position) <= 0.5 * options_.max_deviation;
    hand_.reset();
    if (phases_.phase() == Phase::approach || (phases_.phase() == Phase::run && !near)) {
      blend_ = Ramp(0);
      guidance_.begin();
      begin_approach(state.position);
    }
  }
  return paused_;
}

void GuidanceController::advance(const State& state, Command& command) noexcept {
  if (follow_requests(state)) return;
  phases_.pass(std::min(state.dt, kLongestCursorStep / options_.rate_hz));
  switch (phases_.phase()) {
    case Phase::approach:
      if (!phases_.approached() || !may_begin(state.position)) return;
      phases_.end_approach();
      cursor_time_ = RunningTime();
      tracker_.start();
      walked_.clear();
      walked_length_ = 0;
      guidance_.begin();
      if (wall_ != nullptr) wall_->begin();
      command.event = phases_.repetition_event();
      return;
    case Phase::run: {
      const bool over = options_.time_limit > 0 && phases_.elapsed() >= options_.time_limit;
      if (!over && !arrived()) return;
      if (!arrived()) {
        const double s = tracker_.foot().s;
        const double came = is_at_end(s, path_->length()) && !options_.cursor ? walked_length_ : s;
        command.event = Event{.code = EventCode::time_over, .values = {came, path_->length(), kNaN}};
      }
      phases_.begin_hold();
      return;
    }
    default:
      if (phases_.next_repetition()) begin_approach(state.position);
  }
}

void GuidanceController::tell_initiation(Command& command) noexcept {
  const bool runs = phases_.phase() == Phase::run;
  if (wall_ == nullptr || runs || !ran_ || command.event) {
    ran_ = ran_ || runs;
    return;
  }
  const Initiation& initiation = wall_->initiation();
  command.event = Event{.code = EventCode::initiation,
                        .values = {static_cast<double>(initiation.initiator), initiation.waited, initiation.work}};
  ran_ = false;
}

const PathProjection::Foot& GuidanceController::follow(const State& state) noexcept {
  if (phases_.phase() != Phase::run || paused_)
    return options_.cursor ? tracker_.move_to(tracker_.foot().s, state.position, state.dt)
                           : tracker_.hold(state.position, state.dt);
  if (!options_.cursor) {
    const double before = tracker_.foot().s;
    const PathProjection::Foot& foot = tracker_.update(state.position, state.dt);
    if (!foot.relocated) walked_length_ += walked_.add(before, foot.s);
    return foot;
  }
  const bool waits = options_.wait > 0 && tracker_.foot().distance > options_.wait;
  const double pace = pace_.advance(waits ? 0 : 1, state.dt, kCursorPause);
  cursor_time_ = cursor_time_.after(pace * options_.speed * std::min(state.dt, kLongestCursorStep / options_.rate_hz));
  return tracker_.move_to(path_->place_at(cursor_time_.seconds()), state.position, state.dt);
}

Command GuidanceController::update(const State& state) noexcept {
  Command command;
  advance(state, command);

  const bool guides = phases_.phase() != Phase::approach;
  const double share = blend_.advance(guides ? 1 : 0, state.dt, kBlend);
  Reference way = phases_.approach().at(phases_.elapsed());
  if (guides || share > 0) {
    const PathProjection::Foot& foot = follow(state);
    // While the PD law still pulls, its work on the hand does not count as guidance's.
    if (share < 1) guidance_.begin();
    const bool helps = wall_ != nullptr && phases_.phase() == Phase::run && !paused_;
    if (helps)
      wall_->update(foot, state.position, state.dt);
    else if (wall_ != nullptr)
      wall_->rest(state.dt);
    command.wrench.force = share * guidance_.update(state, foot, options_.cursor);
    if (helps) wall_->acted(share * guidance_.tuning().share * guidance_.tank().share());
    if (guides) {
      way = {.position = foot.place.position,
             .velocity = foot.place.speed * foot.place.tangent,
             .acceleration = Vec3::Zero()};
      command.reference_force = foot.place.force;
      command.progress = foot.s;
      if (options_.tunnel) command.tunnel_radius = guidance_.tuning().radius(foot.place.radius);
      if (!phases_.finished() && !paused_) watch_deviation(std::min(foot.distance, foot.tube.distance), command);
    }
  } else {
    guidance_.rest(state.dt);
  }
  if (!guides && options_.led && !paused_) watch_deviation(norm_of(way.position - state.position), command);
  command.reference = way;
  command.patience = guides ? options_.patience : kPatience;
  if (command.patience > 0) {
    (void)hand_.update(state.force_applied, way.position - state.position, nan3(), state.dt);
    command.resisted = hand_.resists();
  }
  if (share < 1 && options_.led) {
    Reference held = way;
    if (guides) held.velocity = state.velocity;  // the law does not brake a trainee who moves on
    command.wrench.force += (1 - share) * guidance_.tuning().share * pd_force(approach_gains_, state, held);
  }

  if (phases_.phase() == Phase::run && !paused_) watch_forces(state, command);
  tell_initiation(command);
  command.phase = phases_.phase();
  if (phases_.finished() && command.status == Command::Status::working) command.status = Command::Status::finished;
  return command;
}

}  // namespace haptrace

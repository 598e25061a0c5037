#include "scene/slow_scene.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/suggest.h"
#include "control/norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace haptrace {
namespace {

constexpr EnumNames<Prediction, 3> kPredictions{"prediction", {"hold", "linear", "model"}};
constexpr double kFurthest = 1;  // that a line is followed, in times of the distance between its points: 2 oscillate
// A prediction knows the surfaces that the tool reaches at this speed while an answer is in use.
constexpr double kSpeedAhead = 1, kPeriodsAhead = 3;  // [m/s], [periods]
constexpr double kMostOver = 1.5;                     // what it may come to, times the last force

double penetration(const Vec3& velocity, const Vec3& normal) {
  return std::max(0.0, -velocity.dot(normal));
}

}  // namespace

Prediction parse_prediction(std::string_view name) {
  return kPredictions.parse(name);
}

const char* to_string(Prediction prediction) noexcept {
  return kPredictions.name(prediction);
}

int SlowScene::ticks_between(double rate_hz, double servo_rate_hz) {
  check_range("the rate of the scene", rate_hz, 0.1, servo_rate_hz, "Hz");
  return std::max(1, static_cast<int>(std::lround(servo_rate_hz / rate_hz)));
}

SlowScene::SlowScene(std::shared_ptr<Scene> scene, const SlowSceneOptions& options, double servo_rate_hz,
                     double resolution)
    : scene_(std::move(scene)),
      prediction_(options.prediction),
      servo_rate_hz_(servo_rate_hz),
      period_(ticks_between(options.rate_hz, servo_rate_hz)),
      newest_{.contacts = ContactList(scene_->size())},
      before_(newest_),
      predicted_(scene_->size()),
      served_(newest_),
      answers_(newest_) {
  const double rate = servo_rate_hz / period_;
  scene_->prepare({.rate_hz = rate, .ahead = kSpeedAhead * kPeriodsAhead / rate, .resolution = resolution});
  thread_ = std::thread([this] { serve(); });
}

SlowScene::~SlowScene() {
  ending_ = true;
  asked_.fetch_add(1);
  asked_.notify_one();
  thread_.join();
}

void SlowScene::serve() noexcept {
  for (std::uint32_t done = 0;;) {
    asked_.wait(done);
    if (ending_) return;
    const Question question = questions_.latest();
    if (question.number != done) serve(question);
    done = question.number;
  }
}

void SlowScene::serve(Question question) noexcept {
  const Question& last = served_.question;
  if (question.session != last.session) {
    scene_->reset();
    question.touch.dt = 0;
  } else {
    question.touch.dt = static_cast<double>(question.time - last.time) / servo_rate_hz_;
  }
  const std::span<const Contact> contacts = scene_->answer(question.touch).contacts;
  served_.question = question;
  served_.contacts.assign(contacts);
  answers_.post(served_);
  answered_ = question.number;
}

void SlowScene::between_ticks(bool may_wait) noexcept {
  virtual_ = may_wait;
  if (!std::exchange(unsent_, false)) return;
  if (may_wait) {
    serve(question_);
  } else {
    questions_.post(question_);
    asked_ = question_.number;
    asked_.notify_one();
  }
}

void SlowScene::reset() noexcept {
  ++session_;
  time_ = next_ = 0;
  first_ = true;
  for (Answer* answer : {&newest_, &before_}) {
    answer->question = {};
    answer->contacts.clear();
  }
}

SceneAnswer SlowScene::answer(const Touch& touch) noexcept {
  // Time also passes during missed ticks.
  if (!std::exchange(first_, false)) time_ += std::max<std::int64_t>(1, std::llround(touch.dt * servo_rate_hz_));
  take();
  if (time_ >= next_) ask(touch);

  SceneAnswer sum;
  predicted_.clear();
  const bool stale = time_ - newest_.question.time > static_cast<std::int64_t>(kStale) * period_;
  stale_ += stale ? 1 : 0;
  if (stale || !touch.valid()) return sum;
  for (const Contact& last : newest_.contacts.all()) {
    const Contact contact = predicted(last, touch);
    sum.force += contact.force;
    sum.stored += contact.stored;
    predicted_.add(contact);
  }
  sum.contacts = predicted_.all();
  return sum;
}

void SlowScene::take() noexcept {
  const Answer& arrived = answers_.latest();
  const Question& question = arrived.question;
  if (question.session != session_ || question.number == 0 || question.number == newest_.question.number) return;
  if (virtual_ && time_ < question.time + period_) return;
  std::swap(before_, newest_);
  newest_ = arrived;
}

void SlowScene::ask(const Touch& touch) noexcept {
  next_ = time_ + period_;
  late_ += answered_ != question_.number ? 1 : 0;
  question_ = {.number = question_.number + 1, .session = session_, .time = time_, .touch = touch};
  unsent_ = true;
}

Contact SlowScene::predicted(const Contact& last, const Touch& touch) const noexcept {
  switch (prediction_) {
    case Prediction::linear:
      return extrapolated(last);
    case Prediction::model:
      return modelled(last, touch);
    case Prediction::hold:
      break;
  }
  return last;
}

Contact SlowScene::extrapolated(Contact contact) const noexcept {
  if (before_.question.number == 0 || !contact.touched()) return contact;
  const Contact* const before = before_.contacts.find(contact.object);
  const Vec3 force_before = before != nullptr ? before->force : Vec3::Zero();
  const double apart = static_cast<double>(newest_.question.time - before_.question.time);
  const double ahead = std::min(static_cast<double>(time_ - newest_.question.time) / apart, kFurthest);
  const double most = kMostOver * norm_of(contact.force);
  contact.force += ahead * (contact.force - force_before);
  contact.force -= std::min(0.0, contact.force.dot(contact.normal)) * contact.normal;
  contact.force = shortened(contact.force, most);
  return contact;
}

/// The force along the normal follows the plane of the contact, and in front of it the spring of an adhesion. The rest
/// of the force is held while the plane is touched.
Contact SlowScene::modelled(Contact contact, const Touch& touch) const noexcept {
  if (contact.normal.isZero(0)) return contact;
  const bool held = contact.acts();
  // The pull of an adhesion follows from the place alone.
  if (!contact.touched()) contact.force.setZero();
  const double before = std::max(0.0, contact.depth), damped_before = contact.touched() ? contact.damping : 0;
  contact.depth -= contact.normal.dot(touch.position - contact.place);
  contact.place = touch.position;
  const double deeper = std::max(0.0, contact.depth) - before;
  const double pushed = contact.force.dot(contact.normal);
  const double push = pushed + contact.stiffness * deeper +
                      contact.damping * penetration(touch.velocity, contact.normal) -
                      damped_before * penetration(newest_.question.touch.velocity, contact.normal);
  if (contact.touched()) {
    contact.force += (std::max(0.0, push) - pushed) * contact.normal;
    contact.stored = std::max(0.0, contact.stored + 0.5 * contact.stiffness * deeper * (2 * before + deeper));
    return contact;
  }
  const AdhesionSpec adhesion = scene_->object(contact.object).surface().adhesion();
  contact.clings = held && -contact.depth <= adhesion.reach() && adhesion.force > 0;
  const double pull = contact.clings ? adhesion.stiffness * contact.depth : 0;
  contact.force = pull * contact.normal;
  contact.stored = 0.5 * pull * contact.depth;
  return contact;
}

std::vector<std::string> notes_on_prediction(const Scene& scene, Prediction prediction) {
  std::vector<std::string> notes;
  const auto note = [&](bool SurfaceParts::*part, const char* text) {
    std::string names;
    int count = 0;
    for (std::size_t i = 0; i < scene.size(); ++i) {
      if (!(scene.object(i).surface().parts().*part)) continue;
      constexpr int kMostNames = 4;
      if (++count <= kMostNames)
        names += fmt::format("{}'{}'", names.empty() ? "" : ", ", scene.object(i).name());
      else if (count == kMostNames + 1)
        names += ", ...";
    }
    if (count > 0) notes.push_back(fmt::format("the prediction '{}' {}: {}", to_string(prediction), text, names));
  };
  if (prediction == Prediction::model) {
    note(&SurfaceParts::friction, "holds the friction of the last result until the next one");
    note(&SurfaceParts::texture, "does not know a texture's waves between two results");
  }
  if (prediction == Prediction::linear)
    note(&SurfaceParts::adhesion, "holds the pull of an adhesion until the next result");
  return notes;
}

std::vector<std::string> SlowScene::remarks() const {
  std::vector<std::string> remarks;
  if (late_ > 0)
    remarks.push_back(fmt::format(
        "the scene did not keep its rate: {} times, its answer was not ready when the next one was due", late_));
  if (stale_ > 0)
    remarks.push_back(
        fmt::format("for {} ticks, the last answer of the scene was more than {} periods old, so no object was touched",
                    stale_, kStale));
  return remarks;
}

}  // namespace haptrace

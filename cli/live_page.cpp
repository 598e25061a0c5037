#include "cli/live_page.h"

#include "base/error.h"
#include "base/number.h"
#include "devices/sim/hand_steering.h"
#include "player/tuning/private_socket.h"
#include "player/tuning/tuning_server.h"
#include "view/shown_scene.h"

#include <array>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <spawn.h>
#include <thread>
#include <unistd.h>

namespace haptrace::cli {
namespace {

std::uint16_t port_of(const std::string& text) {
  if (text.empty()) return 0;
  const auto port = number_of<std::uint16_t>(text);
  if (!port) throw input_error(fmt::format("--view is '{}'; it must be a port, 0 to 65535, or nothing", text));
  return *port;
}

/// Returns the token in `file`, which is written if it does not exist; empty without a file.
std::string kept_token(const std::string& file) {
  if (file.empty()) return "";
  if (std::filesystem::exists(std::filesystem::symlink_status(file))) return read_tuning_token(file);
  std::string token = new_tuning_token();
  write_tuning_token(token, file);
  return token;
}

/// Writes a page that leads to `address` and that only this user can read. Other users see the arguments of a process,
/// so the address itself, which holds a token, must not be one.
std::string write_redirect(const std::string& address) {
  const std::string file = fmt::format("{}/view-{}.html", runtime_folder(), getpid());
  (void)unlink(file.c_str());
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (descriptor < 0) return "";
  const std::string page = fmt::format(
      "<!doctype html><meta charset=\"utf-8\"><title>haptrace</title><meta http-equiv=\"refresh\" "
      "content=\"0;url={0}\"><a href=\"{0}\">haptrace</a>\n",
      address);
  const bool written = write(descriptor, page.data(), page.size()) == static_cast<ssize_t>(page.size());
  (void)close(descriptor);
  return written ? file : "";
}

}  // namespace

void require_page() {
  if (!view_page_is_built())
    throw input_error(
        "this haptrace was built without the page of the view. Install Node.js and npm, and build it again with "
        "-DHAPTRACE_VIEW=ON");
}

bool open_in_browser(const std::string& address) {
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr) return false;
  std::string file;
  try {
    file = write_redirect(address);
  } catch (const Error&) {
    return false;
  }
  if (file.empty()) return false;
  // The browser is no child to wait for: it may stay open for longer than the session.
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  for (const int descriptor : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    posix_spawn_file_actions_addopen(&files, descriptor, "/dev/null", O_RDWR, 0);
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
  std::array<char*, 3> arguments{const_cast<char*>("xdg-open"), file.data(), nullptr};
  pid_t child = 0;
  const bool started = posix_spawnp(&child, "xdg-open", &files, nullptr, arguments.data(), environ) == 0;
  posix_spawn_file_actions_destroy(&files);
  return started;
}

void ViewArguments::add_to(CLI::App& app) {
  option = app.add_option("--view", port, "show the session in the browser, at any free port unless you name one")
               ->type_name("[PORT]")
               ->expected(0, 1)
               ->group("View");
  app.add_flag("--control", control, "let the page of --view change gains, tunnel and forces, pause, skip and repeat")
      ->group("View");
  app.add_option("--on-page-lost", on_page_lost,
                 "reaction when a controlling page is silent for 2 s: soften | stop | ignore")
      ->capture_default_str()
      ->group("View");
  app.add_option("--view-token-file", token_file,
                 "keep the addresses of --view PORT for several sessions: their tokens are in this file and in "
                 "FILE.trainee, which are written if they do not exist")
      ->type_name("FILE")
      ->group("View");
  app.add_flag("--no-browser", no_browser, "print the addresses of --view only")->group("View");
}

LivePage::LivePage(const ViewArguments& arguments, const SessionArguments& session, const Output& output,
                   std::string verb, StopRequest& stop)
    : output_(output), verb_(std::move(verb)), stop_(stop) {
  const PageLost on_page_lost = parse_page_lost(arguments.on_page_lost);
  const bool steered = session.device.find("intent=view") != std::string::npos;
  if (!arguments.asked()) {
    if (steered) output.remark("intent=view: nobody moves the simulated hand without --view");
    if (arguments.control || arguments.no_browser || !arguments.token_file.empty())
      throw input_error("--control, --no-browser and --view-token-file apply to the live view; give --view as well");
    return;
  }
  require_page();
  view_.emplace(LiveView::Options{
      .port = port_of(arguments.port),
      .token = kept_token(arguments.token_file),
      .trainee_token = kept_token(arguments.token_file.empty() ? "" : arguments.token_file + ".trainee"),
      .control = arguments.control,
      .steer = steered,
      .on_page_lost = on_page_lost,
      .stop_between = &stop_});
  training_.emplace(*view_);
  sinks_.view = &view_->sink();
  const std::string address = view_->address(ViewRole::therapist);
  output.remark("view: " + address);
  output.remark("view for the trainee: " + view_->address(ViewRole::trainee));
  if (!arguments.no_browser) (void)open_in_browser(address);
}

void LivePage::watch(SessionOptions& session) {
  if (!view_) return;
  session.observer = this;
  if (session.clock == ClockChoice::automatic) session.clock = ClockChoice::real;
  session.also_warn([this] { return view_->warnings(); });
}

void LivePage::use(Commands& commands) {
  commands_ = &commands;
  if (training_) training_->ask(&commands);
}

void LivePage::release() {
  commands_ = nullptr;
  if (training_) training_->ask(nullptr);
  if (!view_) return;
  view_->abandon("the session could not be run");
  view_->over(stop_.count() > 0 ? interruption_text(stop_.source()) : "");
}

void LivePage::programme(const nlohmann::json& state) {
  if (view_) view_->programme(state);
}

void LivePage::training(const std::function<void(TrainingProgress&)>& how) {
  if (!training_) return;
  sinks_.training = &*training_;
  training_->change(how);
}

void LivePage::begins(Device& device, const SessionOptions& options, const RecordingColumns& columns,
                      bool virtual_time) {
  const SafetyLimits& limits = options.loop.limits;
  const FollowedPath& followed = options.followed;
  ViewedSession session{.verb = verb_,
                        .mode = followed.mode,
                        .device = device.info(),
                        .rate_hz = options.loop.rate_hz,
                        .virtual_time = virtual_time,
                        .columns = columns,
                        .max_force = limits.max_force > 0 ? limits.max_force : device.info().max_force,
                        .max_speed = limits.max_velocity > 0 ? limits.max_velocity : kNaN,
                        .path = followed};
  ViewTargets targets{.commands = commands_, .steering = steering_of(device), .stop = &stop_};
  if (options.recording) {
    session.name = std::filesystem::path(options.recording->file).filename().string();
    session.title = options.recording->title;
    session.subject = options.recording->subject;
    targets.annotations = options.recording->options.annotations.get();
  }
  if (scene_ != options.touch.scene) {
    scene_ = options.touch.scene;
    view_->scene(scene_ ? shown_objects(*scene_) : std::vector<ShownObject>());
  }
  view_->begin(session, targets);
  if (targets.steering != nullptr && view_->pages() == 0) {
    output_.remark("the session starts when the page is open");
    while (stop_.count() == 0 && !view_->wait_for_page(std::chrono::milliseconds(100))) {
    }
  }
}

}  // namespace haptrace::cli

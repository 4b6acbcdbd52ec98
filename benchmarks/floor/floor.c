/* The floor of the loop benchmark: the same nodes in C, directly on rcl.
 *
 *     floor RATE_HZ JOINTS RECORD NAME...
 *
 * NAME is `sim_0`, `est_0`, `ctrl_0`, `sim_1`, ... One thread waits in one epoll for kernel timers,
 * which are the ticks, and for an eventfd per subscription, to which the middleware's listener
 * writes. No wait set is used, and only the middleware allocates memory between two ticks.
 *
 * Prints `ready` after each node has received a message. When its standard input is closed, writes
 * the nodes' records to the file RECORD, in the format of benchmarks/loop/record.py, and exits.
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include <obelisk_control_msgs/msg/position_setpoint.h>
#include <obelisk_estimator_msgs/msg/estimated_state.h>
#include <obelisk_sensor_msgs/msg/obk_joint_encoders.h>
#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <rosidl_runtime_c/primitives_sequence_functions.h>
#include <rosidl_runtime_c/string_functions.h>

typedef obelisk_control_msgs__msg__PositionSetpoint Setpoint;
typedef obelisk_estimator_msgs__msg__EstimatedState Estimate;
typedef obelisk_sensor_msgs__msg__ObkJointEncoders Encoders;

enum { NS_PER_S = 1000000000, NAME_LENGTH = 32, TOPIC_LENGTH = 64, EVENTS = 16 };

typedef enum { SIM, EST, CTRL, ROLES } Role;

static const char *const ROLE_NAMES[ROLES] = {"sim", "est", "ctrl"};
static const char *const TOPICS[ROLES] = {"encoders", "estimate", "control"};

typedef struct {
  int64_t *at;
  size_t count, room;
} Times; /* [ns] */

typedef struct {
  char name[NAME_LENGTH];
  Role role;
  rcl_node_t node;
  rcl_publisher_t publisher;
  rcl_subscription_t subscription;
  void *received, *sent; /* messages that are reused */
  bool has_received;
  int timer_fd, message_fd;
  int64_t first_tick_ns;
  Times ticks, arrivals, delays;
} Node;

static void must(rcl_ret_t code, const char *what) {
  if (code == RCL_RET_OK) return;
  fprintf(stderr, "%s: %s\n", what, rcl_get_error_string().str);
  exit(1);
}

static void must_system(int code, const char *what) {
  if (code >= 0) return;
  perror(what);
  exit(1);
}

static void must_have(bool exists, const char *what) {
  if (exists) return;
  fprintf(stderr, "%s: out of memory\n", what);
  exit(1);
}

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * NS_PER_S + now.tv_nsec;
}

static void note(Times *times, int64_t at) {
  if (times->count == times->room) {
    times->room = times->room ? 2 * times->room : 1 << 14;
    times->at = realloc(times->at, times->room * sizeof *times->at);
    must_have(times->at != NULL, "notes");
  }
  times->at[times->count++] = at;
}

/* --- messages */

static void fill_numbers(rosidl_runtime_c__double__Sequence *numbers, size_t joints) {
  must_have(rosidl_runtime_c__double__Sequence__init(numbers, joints), "numbers");
  for (size_t i = 0; i < joints; i++) numbers->data[i] = 0.5;
}

static void fill_names(rosidl_runtime_c__String__Sequence *names, size_t joints) {
  must_have(rosidl_runtime_c__String__Sequence__init(names, joints), "names");
  for (size_t i = 0; i < joints; i++) {
    char name[NAME_LENGTH];
    snprintf(name, sizeof name, "joint_%03zu", i);
    must_have(rosidl_runtime_c__String__assign(&names->data[i], name), "names");
  }
}

static void make_messages(Node *node, size_t joints) {
  if (node->role == SIM) {
    Encoders *encoders = obelisk_sensor_msgs__msg__ObkJointEncoders__create();
    fill_numbers(&encoders->joint_pos, joints);
    fill_numbers(&encoders->joint_vel, joints);
    fill_names(&encoders->joint_names, joints);
    node->sent = encoders;
    node->received = obelisk_control_msgs__msg__PositionSetpoint__create();
  } else if (node->role == EST) {
    Estimate *estimate = obelisk_estimator_msgs__msg__EstimatedState__create();
    fill_numbers(&estimate->q_joints, joints);
    fill_numbers(&estimate->v_joints, joints);
    fill_names(&estimate->joint_names, joints);
    node->sent = estimate;
    node->received = obelisk_sensor_msgs__msg__ObkJointEncoders__create();
  } else {
    Setpoint *setpoint = obelisk_control_msgs__msg__PositionSetpoint__create();
    fill_numbers(&setpoint->u_mujoco, joints);
    node->sent = setpoint;
    node->received = obelisk_estimator_msgs__msg__EstimatedState__create();
  }
}

/* Copy from the received message what the next sent message needs. */
static void receive(Node *node) {
  node->has_received = true;
  if (node->role == SIM) {
    const Setpoint *setpoint = node->received;
    int64_t now = now_ns();
    if (setpoint->header.stamp.sec == 0) return;
    note(&node->arrivals, now);
    note(&node->delays,
         now - setpoint->header.stamp.sec * (int64_t)NS_PER_S - setpoint->header.stamp.nanosec);
  } else if (node->role == EST) {
    const Encoders *encoders = node->received;
    Estimate *estimate = node->sent;
    size_t joints = encoders->joint_pos.size;
    estimate->header.stamp = encoders->header.stamp;
    memcpy(estimate->q_joints.data, encoders->joint_pos.data, joints * sizeof(double));
    memcpy(estimate->v_joints.data, encoders->joint_vel.data, joints * sizeof(double));
  } else {
    ((Setpoint *)node->sent)->header.stamp = ((const Estimate *)node->received)->header.stamp;
  }
}

static void take(Node *node) {
  uint64_t count;
  rmw_message_info_t info;
  if (read(node->message_fd, &count, sizeof count) < 0) return;
  while (rcl_take(&node->subscription, node->received, &info, NULL) == RCL_RET_OK) receive(node);
  rcl_reset_error();
}

static void tick(Node *node) {
  uint64_t count;
  if (read(node->timer_fd, &count, sizeof count) < 0) return;
  note(&node->ticks, now_ns());
  if (node->role == SIM) {
    int64_t now = now_ns();
    Encoders *encoders = node->sent;
    encoders->header.stamp.sec = (int32_t)(now / NS_PER_S);
    encoders->header.stamp.nanosec = (uint32_t)(now % NS_PER_S);
  }
  must(rcl_publish(&node->publisher, node->sent, NULL), "publish");
}

/* --- nodes */

static void signal_message(const void *fd, size_t count) {
  eventfd_write((int)(intptr_t)fd, count);
}

static const rosidl_message_type_support_t *type_of(Role role) {
  switch (role) {
    case SIM:
      return ROSIDL_GET_MSG_TYPE_SUPPORT(obelisk_sensor_msgs, msg, ObkJointEncoders);
    case EST:
      return ROSIDL_GET_MSG_TYPE_SUPPORT(obelisk_estimator_msgs, msg, EstimatedState);
    default:
      return ROSIDL_GET_MSG_TYPE_SUPPORT(obelisk_control_msgs, msg, PositionSetpoint);
  }
}

static void open_node(Node *node, const char *name, size_t joints, rcl_context_t *context) {
  const char *loop = strchr(name, '_');
  must_have(loop != NULL && strlen(name) < NAME_LENGTH, name);
  strcpy(node->name, name);
  while (strncmp(ROLE_NAMES[node->role], name, (size_t)(loop - name)) != 0) node->role++;
  make_messages(node, joints);

  Role source = (node->role + ROLES - 1) % ROLES;
  char out[TOPIC_LENGTH], in[TOPIC_LENGTH];
  snprintf(out, sizeof out, "/loop%s/%s", loop, TOPICS[node->role]);
  snprintf(in, sizeof in, "/loop%s/%s", loop, TOPICS[source]);

  rcl_node_options_t options = rcl_node_get_default_options();
  node->node = rcl_get_zero_initialized_node();
  must(rcl_node_init(&node->node, name, "", context, &options), "node");
  rcl_publisher_options_t publishing = rcl_publisher_get_default_options();
  node->publisher = rcl_get_zero_initialized_publisher();
  must(rcl_publisher_init(&node->publisher, &node->node, type_of(node->role), out, &publishing),
       "publisher");
  rcl_subscription_options_t subscribing = rcl_subscription_get_default_options();
  node->subscription = rcl_get_zero_initialized_subscription();
  must(rcl_subscription_init(&node->subscription, &node->node, type_of(source), in, &subscribing),
       "subscription");
}

static void watch(int epoll_fd, int fd, uint64_t mark) {
  struct epoll_event event = {.events = EPOLLIN, .data.u64 = mark};
  must_system(epoll_ctl(epoll_fd, EPOLL_CTL_ADD, fd, &event), "epoll_ctl");
}

/* User data in the epoll: 2 * number for a node's timer, 2 * number + 1 for its messages. */
static void start_node(Node *node, uint64_t number, int64_t period_ns, int epoll_fd) {
  node->message_fd = eventfd(0, EFD_NONBLOCK);
  must_system(node->message_fd, "eventfd");
  watch(epoll_fd, node->message_fd, 2 * number + 1);
  must(rcl_subscription_set_on_new_message_callback(&node->subscription, signal_message,
                                                    (const void *)(intptr_t)node->message_fd),
       "listener");
  node->timer_fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK);
  must_system(node->timer_fd, "timerfd");
  node->first_tick_ns = now_ns() + period_ns;
  struct itimerspec schedule = {
      .it_interval = {period_ns / NS_PER_S, period_ns % NS_PER_S},
      .it_value = {node->first_tick_ns / NS_PER_S, node->first_tick_ns % NS_PER_S}};
  must_system(timerfd_settime(node->timer_fd, TFD_TIMER_ABSTIME, &schedule, NULL), "timerfd");
  watch(epoll_fd, node->timer_fd, 2 * number);
}

static void close_node(Node *node) {
  must(rcl_subscription_fini(&node->subscription, &node->node), "subscription");
  must(rcl_publisher_fini(&node->publisher, &node->node), "publisher");
  must(rcl_node_fini(&node->node), "node");
}

static bool have_all_received(const Node *nodes, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (!nodes[i].has_received) return false;
  return true;
}

static void spin(Node *nodes, size_t count, int epoll_fd) {
  uint64_t end = 2 * count;
  bool is_ready = false;
  watch(epoll_fd, STDIN_FILENO, end);
  for (;;) {
    struct epoll_event events[EVENTS];
    int found = epoll_wait(epoll_fd, events, EVENTS, -1);
    for (int i = 0; i < found; i++) {
      uint64_t mark = events[i].data.u64;
      if (mark == end) return;
      (mark % 2 ? take : tick)(&nodes[mark / 2]);
    }
    if (!is_ready && have_all_received(nodes, count)) {
      is_ready = true;
      puts("ready");
      fflush(stdout);
    }
  }
}

/* --- the record */

static void write_times(FILE *file, const char *name, const Times *times) {
  fprintf(file, ", \"%s\": [", name);
  for (size_t i = 0; i < times->count; i++)
    fprintf(file, "%s%" PRId64, i ? ", " : "", times->at[i]);
  fputs("]", file);
}

static void write_record(const char *path, const Node *nodes, size_t count, int64_t period_ns) {
  FILE *file = fopen(path, "w");
  must_system(file ? 0 : -1, path);
  fputs("[", file);
  for (size_t i = 0; i < count; i++) {
    fprintf(file, "%s{\"name\": \"%s\", \"period_ns\": %" PRId64 ", \"phase_ns\": %" PRId64,
            i ? ", " : "", nodes[i].name, period_ns, nodes[i].first_tick_ns);
    write_times(file, "ticks_ns", &nodes[i].ticks);
    write_times(file, "arrivals_ns", &nodes[i].arrivals);
    write_times(file, "delays_ns", &nodes[i].delays);
    fputs("}", file);
  }
  fputs("]\n", file);
  must_system(fclose(file), path);
}

int main(int argc, char **argv) {
  if (argc < 5) {
    fputs("usage: floor RATE_HZ JOINTS RECORD NAME...\n", stderr);
    return 2;
  }
  int64_t period_ns = NS_PER_S / atoi(argv[1]);
  size_t joints = (size_t)atoi(argv[2]), count = (size_t)argc - 4;
  Node *nodes = calloc(count, sizeof *nodes);
  must_have(nodes != NULL, "nodes");

  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  must(rcl_init_options_init(&options, rcl_get_default_allocator()), "options");
  rcl_context_t context = rcl_get_zero_initialized_context();
  must(rcl_init(0, NULL, &options, &context), "init");
  for (size_t i = 0; i < count; i++) open_node(&nodes[i], argv[i + 4], joints, &context);
  int epoll_fd = epoll_create1(0);
  must_system(epoll_fd, "epoll");
  for (size_t i = 0; i < count; i++) start_node(&nodes[i], i, period_ns, epoll_fd);

  spin(nodes, count, epoll_fd);
  write_record(argv[3], nodes, count, period_ns);
  for (size_t i = 0; i < count; i++) close_node(&nodes[i]);
  must(rcl_shutdown(&context), "shutdown");
  return 0;
}

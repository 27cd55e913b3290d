// The robot's states in words, with what to do in each.

const STATES = {
  disarmed: ["Disarmed", "The drives are off. Arm to begin."],
  commissioning: ["Setting up", "Drives move a little by themselves. Keep clear; STOP and End this step work."],
  homing: ["Homing", "Tendons wind to pretension and are zeroed. Keep clear."],
  ready: ["Ready", "Hold LB, the space bar or an on-screen control to drive."],
  driving: ["Driving", "Let go to stop."],
  holding: ["Holding", "Let go, centre the sticks, then press again."],
  stopped: ["Stopped", "Look, then clear the stop to go on."],
  fault: ["Fault", "Mend what is wrong, then arm again."],
  offline: ["Cut off", "No connection to the console. Trying again by itself."],
  gone: ["Robot gone", "The robot process has ended. Restart it to go on; it comes back disarmed."],
  silent: ["No data", "The robot's state does not arrive. What is shown is old."],
};

const POWERED = ["homing", "commissioning", "ready", "driving", "holding", "stopped"];

/** The phase as the page shows it: what is known about the link outweighs what the last state said. */
export function shownPhase(state, connected) {
  if (!connected || !state) return "offline";
  if (!state.link.robot) return "gone";
  if (!state.link.ok) return "silent";
  return state.phase in STATES ? state.phase : "silent";
}

export function stateWord(phase) {
  return STATES[phase][0];
}

/**
 * Why it is in that state and what to do: the robot's own words where it gave any.
 *
 * @param may whether this page may drive; to others how to drive is no help
 */
export function causeOf(phase, state, may) {
  const own = ["offline", "silent"].includes(phase) ? "" : state.cause;
  if (own) return own.charAt(0).toUpperCase() + own.slice(1);
  if (phase === "disarmed" && state.reasons.length) return "The drives are off. What still prevents arming is listed beside Arm.";
  const holder = state?.lease.holder;
  if (!may && phase === "driving") return holder ? `${holder} drives.` : "";
  if (!may && phase === "ready") return holder ? `${holder} has the controls.` : "Nobody has the controls.";
  return STATES[phase][1];
}

/** Which buttons make sense; the robot decides again and says why not. */
export function possible(phase, reasons) {
  return {
    arm: ["disarmed", "fault"].includes(phase) && reasons.length === 0,
    disarm: POWERED.includes(phase),
    home: ["ready", "holding"].includes(phase),
    clear: phase === "stopped",
  };
}

/** Above the list of reasons. */
export function reasonsTitle(phase, reasons) {
  if (reasons.length) return phase === "stopped" ? "Before it goes on" : "Before arming";
  if (phase === "disarmed" || phase === "fault") return "Nothing prevents arming.";
  return POWERED.includes(phase) ? "The drives are on." : "";
}

export const REQUESTS = {
  identify: "Identify", test: "Test", home_repeatedly: "Homing", tare: "Tare", calibrate_cell: "Calibration", abort: "Ending", resume: "Kept zeros",
  arm: "Arm", disarm: "Disarm", home: "Home", clear: "Clear", stop: "STOP", quit: "Quit",
  lock: "Lock", unlock: "Unlock", restart_robot: "Restart", section: "Section", speed: "Speed",
  mode: "Mode", frame: "View", pose: "Pose",
  save_pose: "Save", delete_pose: "Delete", hand_feed: "Length",
  acquire: "Taking the controls", release: "Letting go", take: "Taking over", ask: "Asking", withdraw: "Withdrawing",
  grant: "Giving the controls", refuse: "Refusing", console_pad: "The console's pad", mark: "The note",
  compensation: "Compensation",
};

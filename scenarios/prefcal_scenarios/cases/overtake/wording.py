"""Describe the overtaking for the person who compares: the task, its knobs and its KPIs."""

from collections.abc import Mapping

BRIEF = (
    "A car keeps its lane at 50 km/h, comes up behind a slower one, overtakes it on the left and "
    "returns to its lane, all within 15 s. A model predictive controller (MPC) sets speed and "
    "steering. Each experiment is one simulated drive with other controller settings. Prefer the "
    "drive that you would rather sit in: safe distance beside the other car, no sharp steering, "
    "little swinging before and after, and a controller that is done within its sampling time."
)
CONFIGURED = f"{BRIEF} Road and traffic are those of a configuration."
KNOBS: Mapping[str, str] = {
    "T_s": "Sampling time: how often the controller measures and steers. A short one reacts "
    "sooner, but leaves less time to compute.",
    "ε_c": "Share of the prediction horizon in which the controller plans free moves; after that "
    "it holds them. A larger share plans in more detail and takes longer to compute.",
    "N_p": "Prediction horizon: how many samples the controller looks ahead.",
    "log q_u11": "Weight of changes of speed, as a power of ten. High keeps the speed steady.",
    "log q_u22": "Weight of changes of the steering angle, as a power of ten. High steers gently, "
    "low steers sharply.",
}
KPIS: Mapping[str, str] = {
    "t_comp_ratio": "Longest computation of one control step as a share of the sampling time. "
    "Above 1 the controller is too slow to run in real time.",
    "lateral_distance": "Smallest sideways distance between the center lines of the two cars "
    "while they are side by side. The reference is 3 m.",
    "path_peak": "Largest distance from the center of the car's lane; the target while passing is 3 m.",
    "t_comp_worst": "Longest computation of one control step, modeled for one processor.",
    "t_comp_99": "Computation time that 99 % of the steps stay below, modeled in the same way.",
    "collision": "Whether the car touched the other one (1) or not (0).",
    "off_road": "How far the car's body left the road.",
    "clearance": "Smallest gap between the bodies of the two cars, in any direction.",
    "overtaking_time": "From the decision to overtake until the decision to return to the lane.",
    "overshoot": "How far the car swung beyond the target of 3 m while passing.",
    "lane_deviation": "Largest distance from the center of the lane while keeping it.",
    "lane_yaw": "Largest angle between the car and its lane while keeping it.",
    "lateral_acceleration": "Largest sideways acceleration. Passengers notice 2 m/s², and above "
    "about 8 m/s² tires slide.",
    "lateral_acceleration_rms": "Typical sideways acceleration: root of the mean square.",
    "lateral_jerk": "Largest change of the sideways acceleration: jolts that passengers feel.",
    "lateral_jerk_rms": "Typical change of the sideways acceleration: root of the mean square.",
    "speed_error": "Typical difference between speed and the wanted speed.",
    "speed_variation": "Sum of all changes of speed, up and down: small is smooth.",
    "steering": "Largest steering angle.",
    "steering_move": "Largest change of the steering angle from one step to the next.",
    "steering_rate": "Largest speed of the steering.",
    "steering_rate_rms": "Typical speed of the steering: root of the mean square.",
    "unsolved": "Steps at which the controller found no solution of its optimization problem (a "
    "quadratic program, QP) and held speed and steering. 0 is normal.",
}

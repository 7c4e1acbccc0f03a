"""Estimation of mass, centre of mass, yaw inertia and friction together, with its uncertainty; MuJoCo is the model.

copies = Copies(scene, body)                            # the model, as often as needed
tracker = Tracker(copies, noise_sd)                    # of the measured state, (6,)
belief = tracker.start(Prior(to_vector(body), sd), first)    # first: (N, 6), N lanes side by side
belief = tracker.update(belief, pushes, measured)       # pushes since the last message (n, 12), message (N, 6)
to_values(belief.x, body.half_size_m), belief.sd, belief.now
"""

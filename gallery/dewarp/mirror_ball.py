"""Panorama of a mirror ball, given the centre and radius of its outline."""

import omnimirror as om

ball = om.MirrorBall(
    centre_px=(299.5, 299.5), rim_radius_px=280.0, field_deg=280.0, image_size=(600, 600)
)
image = om.render_image(ball, om.load_scene("street"), samples=4)
om.write_image("mirror_ball.png", om.Dewarper(ball, om.views.panorama(ball, (1000, None)))(image))

"""What happens in a step: forces, contact, methods, rigid bodies, measures."""
